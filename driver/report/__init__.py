"""Pictures and one self-contained page from the results of a case.

The page is `page`, its numbers `findings`, its tables `tables`. Figures stand by their subject:
of free correlation in `measured_maps` and `measured_curves` (listed in `measured_figures`), of the
grips in `grip_figure`, of models and misfits in `maps` and `figures`, of the fit in
`history_figures` and `matrix_figures`, of causes in `evidence_figures`; `all_figures` lists those
of the page. `style` is their look.
"""

# Loaded before anything else loads matplotlib.
from driver.report import drawing_library as drawing_library

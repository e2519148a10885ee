"""Pictures and one self-contained page from the results of a case.

The page is `page`, its head `first_screen` and `verdict`, its numbers `findings`, its tables
`tables` and `final_parameters`. What it shows image by image is `view`: `face_blocks` and
`specimen_surface` make the arrays, `packed_arrays` packs them, and `plotting_library` is what draws
them in the browser. Figures stand by their subject:
of free correlation in `measured_maps` and `measured_curves` (listed in `measured_figures`), of the
grips in `grip_figure`, of models and misfits in `maps` and `figures`, of the fit in
`history_figures` and `matrix_figures`, of causes in `evidence_figures`, of the critical stress
inside grains in `stress_figure`; `all_figures` lists those of the page. `style` is their look,
`vector_files` writes them for a paper.
"""

# Loaded before anything else loads matplotlib.
from driver.report import drawing_library as drawing_library

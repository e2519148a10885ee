"""The pictures of free correlation, drawn by the stage that measures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from driver.report import grip_figure, measured_curves, measured_maps
from driver.report.measured import MeasuredMotion
from driver.report.style import png

FIGURES: dict[str, Callable[[MeasuredMotion], Figure]] = {
    "measure_reference": measured_maps.reference,
    "measure_fields": measured_maps.fields,
    "measure_travel": measured_curves.travel,
    "measure_grip": grip_figure.grip,
    "measure_residuals": measured_maps.residuals,
    "measure_noise": measured_curves.noise,
}


def write_figures(measured: MeasuredMotion, folder: Path) -> None:
    """Draw all pictures, in the order of the report, into `folder` as PNG files."""
    for name, draw in FIGURES.items():
        (folder / f"{name}.png").write_bytes(png(draw(measured)))

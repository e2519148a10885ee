"""The pictures of free correlation, drawn by the stage that measures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from matplotlib.figure import Figure

from driver.report import grip_figure, measured_curves, measured_maps
from driver.report.measured import MeasuredMotion
from driver.report.style import png
from driver.results.files import (
    MEASURE_FIELDS,
    MEASURE_GRIP,
    MEASURE_NOISE,
    MEASURE_REFERENCE,
    MEASURE_RESIDUALS,
    MEASURE_TRAVEL,
)

FIGURES: dict[str, Callable[[MeasuredMotion], Figure]] = {
    MEASURE_REFERENCE: measured_maps.reference,
    MEASURE_FIELDS: measured_maps.fields,
    MEASURE_TRAVEL: measured_curves.travel,
    MEASURE_GRIP: grip_figure.grip,
    MEASURE_RESIDUALS: measured_maps.residuals,
    MEASURE_NOISE: measured_curves.noise,
}


def write_figures(measured: MeasuredMotion, folder: Path) -> None:
    """Draw all pictures, in the order of the report, into `folder` as PNG files."""
    for name, draw in FIGURES.items():
        (folder / name).write_bytes(png(draw(measured)))

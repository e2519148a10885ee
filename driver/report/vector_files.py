"""The figures of the page as PDF and SVG files."""

from __future__ import annotations

from pathlib import Path

from matplotlib.figure import Figure

from driver.report.measured import MeasuredMotion
from driver.report.measured_figures import FIGURES
from driver.report.style import saved
from driver.results.files import vector_figure


def write_vectors(name: str, figure: Figure, folder: Path) -> None:
    """Write a figure as PDF and SVG into a folder, which is made where there is none.

    Raises:
        OSError: a file cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for kind in ("pdf", "svg"):
        (folder / vector_figure(name, kind)).write_bytes(saved(figure, kind))


def write_measured_vectors(motion: MeasuredMotion, folder: Path) -> None:
    """Write the pictures of free correlation, drawn anew.

    Raises:
        OSError: a file cannot be written.
    """
    for name, draw in FIGURES.items():
        write_vectors(Path(name).stem, draw(motion), folder)

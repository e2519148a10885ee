"""The picture of the noise floor: errors against mesh size, and the mesh to take."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from driver.noise_floor.floor import PAPER_GAMMA_U
from driver.report.style import AFTER, BEFORE, GREY, MEASURED, grid, new_figure, styled
from driver.results.noise_floor import Row, over_motions

_BIAS, _SCATTER = BEFORE, AFTER
_PANELS = (
    ("strain", "strain ε_YY at a pixel [%]", 100.0),
    ("u", "u [nm]", 1e3),
    ("v", "v [nm]", 1e3),
    ("w", "w [nm]", 1e3),
)


@styled
def draw(rows: Sequence[Row], take: Row, freedom: int) -> Figure:
    """Elongation, strain and motion against the size of the elements.

    Args:
        rows: the meshes.
        take: the mesh to take.
        freedom: degrees of freedom of the scatter of the repeats.
    """
    figure = new_figure(7.0)
    grids = figure.add_gridspec(2, 6)
    _elongation(figure.add_subplot(grids[0, :3]), rows, take, freedom)
    places = (grids[0, 3:], grids[1, :2], grids[1, 2:4], grids[1, 4:])
    for place, (quantity, label, factor) in zip(places, _PANELS, strict=True):
        axes = figure.add_subplot(place)
        sizes = [row.size for row in rows]
        for name, colour in (("bias", _BIAS), ("scatter", _SCATTER)):
            values = [over_motions(getattr(row.errors, name)[quantity]) * factor for row in rows]
            axes.plot(sizes, values, "o-", color=colour, label=name)
        total = [row.errors.total(quantity) * factor for row in rows]
        axes.plot(sizes, total, color=MEASURED, linewidth=1.0, label="both")
        _dress(axes, rows, take, label)
        if quantity == "strain":
            axes.legend()
    return figure


def _elongation(axes: Axes, rows: Sequence[Row], take: Row, freedom: int) -> None:
    sizes = np.array([row.size for row in rows])
    errors_of_meshes = [row.errors for row in rows]
    predicted = [1e3 * errors.predicted for errors in errors_of_meshes]
    axes.plot(sizes, predicted, color=AFTER, label="noise by the covariance")
    scatter = [1e3 * over_motions(errors.scatter["elongation"]) for errors in errors_of_meshes]
    axes.plot(sizes, scatter, "s", color=AFTER, label="noise in the laboratory")
    bias = [1e3 * over_motions(errors.bias["elongation"]) for errors in errors_of_meshes]
    axes.plot(sizes, bias, "o-", color=BEFORE, label="bias")
    measured = np.array([1e3 * row.measured for row in rows])
    share = 1 / np.sqrt(2 * freedom)
    axes.errorbar(
        sizes,
        measured,
        share * measured,
        fmt="o",
        color=MEASURED,
        capsize=3,
        label="noise by repeats",
    )
    axes.axhline(1e3 * PAPER_GAMMA_U, color=GREY, linestyle=":", label="the paper")
    _dress(axes, rows, take, "elongation [nm]")
    axes.set_ylim(top=1.4 * axes.get_ylim()[1])  # room for the legend
    axes.legend(ncols=2, loc="upper right")


def _dress(axes: Axes, rows: Sequence[Row], take: Row, label: str) -> None:
    axes.axvline(take.size, color=GREY, linewidth=6, alpha=0.25)
    axes.set_xscale("log")
    sizes = [row.size for row in rows]
    axes.set_xticks(sizes, [f"{size:g}" for size in sizes])
    axes.minorticks_off()
    axes.set_ylim(bottom=0.0)
    axes.set_title(label)
    axes.set_xlabel("element [px]")
    grid(axes)

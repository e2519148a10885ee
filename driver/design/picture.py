"""The picture of a design: what is known, what would show, and what changes would buy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import TwoSlopeNorm
from matplotlib.figure import Figure

from driver.design.comparison import by_group, gain
from driver.design.detectability import NAMED_AT
from driver.design.forecast import Forecast
from driver.design.information import SOURCES, groups_of
from driver.design.text import shown
from driver.diagnosis.statistics.score_test import SEEN_AT
from driver.report.style import CATEGORIES, GREY, grid, new_figure, styled
from driver.results.design import Knowledge

_ROW, _ROOM = 0.2, 1.8  # in; height of a row, and of what stands above and below them
_FARTHEST = 30.0  # usual sizes; what is farther is drawn there
_COLOURS = dict(zip(SOURCES, ("#56b4e9", "#d55e00", "#7f7f7f", "#e6d9a8"), strict=True))


@styled
def draw(base: Forecast, others: Sequence[Forecast]) -> Figure:
    """Variance of the parameters by source, visibility of the causes, gain of the changes.

    Args:
        base: the experiment of the case.
        others: the changed experiments.
    """
    known, causes = _representatives(base), sorted(base.causes, key=lambda o: o.in_scales)
    rows = len(known) + len(causes)
    figure = new_figure(_ROW * rows + _ROOM + (1.2 if others else 0.0), 12.0)
    heights = [len(known), len(causes)] if causes else [len(known)]
    grids = figure.add_gridspec(
        len(heights), 2 if others else 1, height_ratios=heights,
        width_ratios=[1.0, 0.9] if others else None,
    )  # fmt: skip
    _parameters(figure.add_subplot(grids[0, 0]), known)
    if causes:
        _causes(figure.add_subplot(grids[1, 0]), base)
    if others:
        gains = [gain(base, other) for other in others]
        means = [by_group(won.sigma) for won in gains]
        names = list(groups_of([p.name for p in base.parameters]))
        names = [group for group in names if any(group in mean for mean in means)]
        top = figure.add_subplot(grids[0, 1])
        _ratios(top, names, [[mean.get(name, np.nan) for mean in means] for name in names])
        top.set_title("σ with a change over σ without")
        top.set_xticks(range(len(others)), [o.variant.name for o in others], rotation=35, ha="left")
        top.xaxis.tick_top()
    if others and causes:
        low = figure.add_subplot(grids[1, 1])
        listed = [o.cause.name for o in causes]
        _ratios(low, listed, [[won.seen.get(name, np.nan) for won in gains] for name in listed])
        low.set_title("smallest magnitude seen, over that without")
        low.set_xticks([])
    return figure


def _representatives(base: Forecast) -> list[Knowledge]:
    """Each parameter; of the knots of each motion the one that is known worst."""
    knots = groups_of([p.name for p in base.parameters]).get("the knots", ())
    chosen = [p for p in base.parameters if p.name not in knots]
    for start in ("elongation", "tilt"):
        ones = [p for p in base.parameters if p.name in knots and p.name.startswith(start)]
        chosen += sorted(ones, key=lambda p: -p.theta)[:1]
    return chosen


def _parameters(axes: Axes, known: Sequence[Knowledge]) -> None:
    places = np.arange(len(known))
    left = np.zeros(len(known))
    for source in SOURCES:
        share = np.array([p.parts[source] for p in known])
        axes.barh(places, share, left=left, color=_COLOURS[source], label=source)
        left += share
    axes.set_yticks(places, [f"{p.name} ± {shown(p.sigma, p.unit)}" for p in known])
    axes.set_xlim(0, 1)
    axes.invert_yaxis()
    axes.set_title("what the variance of a parameter comes from")
    axes.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, 0.0))
    axes.set_xticks([])


def _causes(axes: Axes, base: Forecast) -> None:
    causes = sorted(base.causes, key=lambda o: o.in_scales)
    places = np.arange(len(causes))
    seen = np.minimum([o.in_scales for o in causes], _FARTHEST)
    named = np.minimum(np.array([o.in_scales for o in causes]) * NAMED_AT / SEEN_AT, _FARTHEST)
    colours = [CATEGORIES[o.cause.category] for o in causes]
    least = min(0.08, float(seen.min()) / 2)
    axes.hlines(places, seen, named, colors=colours, linewidth=3.0, alpha=0.4)
    axes.scatter(seen, places, c=colours, s=30, zorder=3)
    axes.axvline(1.0, color=GREY, linestyle=":")
    axes.set_xscale("log")
    axes.set_xlim(least, 1.1 * _FARTHEST)
    ticks = [t for t in (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0) if t > least]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set_yticks(places, [o.cause.name for o in causes])
    axes.invert_yaxis()
    axes.set_xlabel("usual sizes (dot: seen; end of the line: named)")
    axes.set_title("smallest magnitude of a cause that would show")
    for name, colour in CATEGORIES.items():
        if any(o.cause.category == name for o in causes):
            axes.scatter([], [], c=colour, s=30, label=name)
    axes.legend(loc="upper right")
    grid(axes)


def _ratios(axes: Axes, names: Sequence[str], ratios: Sequence[Sequence[float]]) -> None:
    table = np.array(ratios)
    shades = np.clip(np.log2(np.where(table > 0, table, 1.0)), -2.0, 2.0)
    axes.imshow(shades, cmap="RdBu_r", norm=TwoSlopeNorm(0.0, -2.0, 2.0), aspect="auto")
    for (row, column), ratio in np.ndenumerate(table):
        if np.isfinite(ratio):
            dark = abs(shades[row, column]) > 1.3
            axes.text(
                column, row, f"{ratio:.2f}", ha="center", va="center", fontsize=7.5,
                color="white" if dark else "black",
            )  # fmt: skip
    axes.set_yticks(range(len(names)), names)
    axes.tick_params(length=0)
    for side in axes.spines.values():
        side.set_visible(False)

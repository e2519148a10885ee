"""How parameters and misfit went over the iterations of the identification."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from driver.common.formatting import chi, number
from driver.report.style import (
    AFTER,
    BEFORE,
    CYCLES,
    GREY,
    MEASURED,
    grid,
    new_figure,
    styled,
    typeset,
)
from meshes.arrays import FloatArray

Parts = Sequence[FloatArray]  # one array for each stage

_COLOURS = (AFTER, BEFORE, CYCLES[1], CYCLES[2], CYCLES[0], CYCLES[3], MEASURED, CYCLES[4])
_MARKS = "osD^vP*X"
_APART = 0.075  # of the height of the axes, between labels at the end of curves


@dataclass(frozen=True, eq=False)
class Course:
    """A parameter over the iterations.

    Attributes:
        label: as it is written.
        unit: in which its values are read.
        values: in that unit, NaN where the parameter was held.
        sigma: standard deviation at the end, NaN where it was held.
    """

    label: str
    unit: str
    values: Parts
    sigma: float

    @property
    def last(self) -> float:
        """The value at the end, or where it was free last."""
        every = np.concatenate(list(self.values))
        return float(every[np.isfinite(every)][-1])


@styled
def convergence(
    stages: Sequence[str],
    chis: Mapping[str, Parts],
    kinematic: Sequence[Course],
    material: Sequence[Course],
) -> Figure:
    """Parameters and χ over the iterations, stage by stage.

    Args:
        stages: names of the stages.
        chis: measures of the misfit by name, loads first, NaN where there are none.
        kinematic: apex amplitudes, drawn as they are.
        material: other parameters, drawn over their start.
    """
    rows = [row for row in (kinematic, material) if row]
    figure = new_figure(2.5 * (len(rows) + 1) + 0.4)
    panels = figure.subplots(len(rows) + 1, 1, sharex=True, squeeze=False)[:, 0]
    for axes, courses in zip(panels, rows, strict=False):
        relative = courses is material
        _courses(axes, courses, relative)
        axes.set_ylabel("value / start [1]" if relative else "apex amplitude [1]")
    last = panels[-1]
    ends = []
    for (name, parts), colour, mark in zip(
        chis.items(), (BEFORE, AFTER, CYCLES[0]), "so^", strict=False
    ):
        every = np.concatenate(list(parts))
        last.semilogy(np.arange(every.size), every, mark + "-", ms=4.5, lw=1.3, color=colour)
        ends.append((float(every[-1]), f"{name}: {chi(float(every[-1]))}", colour))
    last.axhline(1.0, color=GREY, lw=1.0, ls="--")
    last.set(ylabel="χ [1], 1 is noise", xlabel="iteration; the first of a stage is its start")
    last.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    last.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    last.yaxis.set_minor_formatter(NullFormatter())
    bounds = np.cumsum([0, *(len(part) for part in next(iter(chis.values())))])
    for axes in panels:
        for k in range(1, len(stages), 2):
            axes.axvspan(bounds[k] - 0.5, bounds[k + 1] - 0.5, color=GREY, lw=0, alpha=0.10)
        grid(axes)
    for k, name in enumerate(stages):
        panels[0].text((bounds[k] + bounds[k + 1] - 1) / 2, 1.02, name, ha="center", va="bottom",
                       transform=panels[0].get_xaxis_transform(), weight="bold")  # fmt: skip
    last.set_xlim(-0.5, bounds[-1] - 0.5)
    _label_ends(last, ends)
    return figure


def _courses(axes: Axes, courses: Sequence[Course], relative: bool) -> None:
    ends = []
    for index, course in enumerate(courses):
        every = np.concatenate(list(course.values))
        colour, mark = _COLOURS[index % len(_COLOURS)], _MARKS[index % len(_MARKS)]
        scale = float(every[np.isfinite(every)][0]) if relative else 1.0
        scale = scale if scale != 0.0 else 1.0
        drawn, reach = every / scale, abs(1.96 * course.sigma / scale)
        at = np.arange(every.size)
        held = np.isnan(drawn)
        axes.plot(at, drawn, mark + "-", ms=4.5, lw=1.3, color=colour)
        # A parameter that is held keeps its value.
        known = np.interp(at, at[~held], drawn[~held])
        for k in np.flatnonzero(held):
            axes.plot(at[max(k - 1, 0) : k + 2], known[max(k - 1, 0) : k + 2], ":", lw=1.0,
                      color=colour)  # fmt: skip
        if np.isfinite(reach):
            axes.errorbar(at[-1], known[-1], reach, color=colour, capsize=3.5, lw=1.3)
        text = f"{course.label} = {number(course.last, 3)} {course.unit}".rstrip()
        ends.append((float(known[-1]), text, colour))
    axes.axhline(1.0, color=GREY, lw=1.0, ls="--")
    _label_ends(axes, ends)


def _label_ends(axes: Axes, ends: Sequence[tuple[float, str, str]]) -> None:
    """Write to the right of each curve what it is, the texts moved apart where they would touch."""
    to_axes = axes.transData + axes.transAxes.inverted()
    order = sorted(range(len(ends)), key=lambda k: ends[k][0])
    wanted = [float(to_axes.transform((0.0, ends[k][0]))[1]) for k in order]
    for k, place in zip(order, spread(wanted, _APART), strict=True):
        _, text, colour = ends[k]
        axes.annotate(typeset(text), (1.0, place), xycoords="axes fraction", xytext=(8, 0),
                      textcoords="offset points", va="center", color=colour, fontsize=9.0,
                      weight="bold", annotation_clip=False)  # fmt: skip


def spread(places: Sequence[float], apart: float) -> list[float]:
    """Places in ascending order, moved as little as keeps them apart (least squares)."""
    clusters: list[tuple[float, int]] = []  # sum of place − k·apart, and number of members
    for k, place in enumerate(places):
        total, count = place - k * apart, 1
        while clusters and clusters[-1][0] / clusters[-1][1] > total / count:
            before, members = clusters.pop()
            total, count = total + before, count + members
        clusters.append((total, count))
    levels = [total / count for total, count in clusters for _ in range(count)]
    return [level + k * apart for k, level in enumerate(levels)]

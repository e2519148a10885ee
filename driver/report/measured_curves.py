"""Curves of what free correlation has measured: its noise, and motion over stage travel."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from driver.report.measured import BAND, BINS, Curve, MeasuredMotion, phases
from driver.report.style import AFTER, BEFORE, GREY, MEASURED, grid, new_figure, styled

LOADING, UNLOADING = AFTER, BEFORE
_MARKS = "os^v*"  # of the cycles, again from the first after five
_WIDTH = BINS[1] - BINS[0]


@styled
def noise(measured: MeasuredMotion) -> Figure:
    """Histogram of ρ/σ over all pixels and images against the unit normal, and χ of each image."""
    figure = new_figure(3.4)
    shares, curve = figure.subplots(1, 2, width_ratios=(1.0, 1.25))
    n = measured.spread.n
    density = measured.spread.counts / (n * _WIDTH)
    shares.stairs(density, BINS, fill=True, color=AFTER, alpha=0.35)
    shares.stairs(density, BINS, color=AFTER, lw=1.2, label="all pixels and images")
    at = np.linspace(BINS[0], BINS[-1], 241)
    shares.plot(at, np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi), "--", color=MEASURED, lw=1.4,
                label="unit normal")  # fmt: skip
    shares.set_yscale("log")
    shares.set_ylim(0.3 / (n * _WIDTH), 5.0)
    shares.set(xlabel="ρ/σ [1]", ylabel="probability density [1]", xlim=(BINS[0], BINS[-1]),
               title="Residuals against pure noise")  # fmt: skip
    shares.legend(loc="upper left")
    image = np.arange(len(measured.chi))
    curve.plot(image, measured.chi, ".-", ms=4, lw=0.9, color=AFTER)
    failed = image[~measured.converged]
    if failed.size:
        curve.plot(failed, measured.chi[failed], "x", ms=7, mew=1.6, color=MEASURED,
                   label="not converged")  # fmt: skip
    curve.axhline(1.0, color=MEASURED, lw=1.4, ls="--", label="noise alone")
    for k, shown in enumerate(measured.shown):
        curve.axvline(shown, color=GREY, lw=0.9, ls=":", label="" if k else "shown as maps")
    low, high = min(0.95, measured.chi.min()), max(1.05, measured.chi.max())
    curve.set_ylim(1.1 * low - 0.1 * high, 1.25 * high - 0.25 * low)
    curve.set(xlabel="image", ylabel="χ of free correlation [1]", title="Residual of each image")
    curve.legend(loc="upper left", ncols=2, frameon=True, framealpha=1.0, edgecolor="none")
    for axis in (shares, curve):
        grid(axis)
    return figure


@styled
def travel(measured: MeasuredMotion) -> Figure:
    """Elongation, tilt and mean w over stage travel, loading and unloading, with 95 % bands."""
    figure = new_figure(4.0)
    panels = figure.subplots(1, 3, width_ratios=(1.3, 1.0, 1.0), gridspec_kw={"wspace": 0.06})
    for axis, curve, what, title in (
        (panels[0], measured.elongation, "elongation", "Elongation, v(S⁺) − v(S⁻)"),
        (panels[1], measured.tilt, "tilt", "Tilt, w(S⁺) − w(S⁻)"),
        (panels[2], measured.mean_w, "mean of w", "Mean w, with the focus"),
    ):
        _draw(axis, measured, curve)
        axis.set(ylabel=f"{what} [nm]", title=title)
        axis.set_xlabel("stage travel [µm]")
        grid(axis)
    cycles = np.unique(measured.cycle)
    key: list[Line2D | Patch] = [
        Line2D([], [], color=LOADING, lw=1.6, label="loading"),
        Line2D([], [], color=UNLOADING, lw=1.6, ls="--", label="unloading"),
        Patch(color=GREY, alpha=0.3, label="95 % band"),
    ]
    key += [
        Line2D([], [], color=GREY, marker=_mark(k), ls="", ms=5, label=f"cycle {cycle}")
        for k, cycle in enumerate(cycles[: len(_MARKS)])
    ]
    figure.legend(handles=key, loc="outside lower center", ncols=min(len(key), 6))
    return figure


def _draw(axis: Axes, measured: MeasuredMotion, curve: Curve) -> None:
    value, half = 1e3 * curve.value, 1e3 * BAND * curve.sigma
    cycles = np.unique(measured.cycle).tolist()
    for loading, images in phases(measured.stage, measured.cycle):
        colour, stage = LOADING if loading else UNLOADING, measured.stage[images]
        axis.fill_between(stage, (value - half)[images], (value + half)[images], color=colour,
                          alpha=0.13, lw=0)  # fmt: skip
        mark = _mark(cycles.index(measured.cycle[images[-1]]))
        # The first image of a phase has its mark as the last one of the phase before.
        axis.plot(stage, value[images], "-" if loading else "--", marker=mark, ms=3.6, lw=1.1,
                  color=colour, markevery=slice(int(images[0] > 0), None))  # fmt: skip


def _mark(cycle: int) -> str:
    return _MARKS[cycle % len(_MARKS)]

"""Curves and bars of the report, from arrays to figures; lengths come in µm, loads in µN."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

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
from meshes.arrays import FloatArray, IntArray

SIDE_COLOURS = {"before": BEFORE, "after": AFTER}


def side_labels(sides: Sequence[str]) -> dict[str, str]:
    """Names of the models in legends."""
    if len(sides) == 1:
        return {sides[0]: "identified model"}
    return {"before": "model before", "after": "extended model"}


@styled
def budget(free: float, sides: Mapping[str, Mapping[str, float]]) -> Figure:
    """Bars of χ from noise over free correlation to the models, for images and loads.

    Args:
        free: χ of free correlation, pixel by pixel.
        sides: χ of "before" (and "after"): "model" (pixel by pixel), "basis" (on the
            correlation mesh), "load" (χ_F).
    """
    figure = new_figure(2.9)
    axes = figure.subplots(1, 3, width_ratios=(4, 3, 3))
    names = side_labels(tuple(sides))
    for axis, key, title in (
        (axes[0], "model", "Images, pixel by pixel"),
        (axes[1], "basis", "Images, correlation mesh"),
        (axes[2], "load", "Loads"),
    ):
        bars = [("noise", 1.0, GREY)]
        if key == "model":
            bars.append(("free\ncorrelation", free, CYCLES[0]))
        bars += [
            (names[side].replace(" ", "\n"), of_side[key], SIDE_COLOURS[side])
            for side, of_side in sides.items()
        ]
        for place, (_, height, colour) in enumerate(bars):
            axis.bar(place, height, width=0.65, color=colour)
            # On white, or the line of noise would strike out a number just below it.
            axis.annotate(chi(height), (place, height), (0, 2.5), textcoords="offset points",
                          ha="center", va="bottom", weight="bold",
                          bbox={"facecolor": "white", "lw": 0, "pad": 0.6})  # fmt: skip
        axis.axhline(1.0, color=GREY, lw=1.0, ls="--", zorder=0)
        axis.set_xticks(range(len(bars)), [name for name, _, _ in bars])
        axis.set_ylim(0.0, 1.18 * max(height for _, height, _ in bars))
        axis.set(title=title, ylabel=typeset("χ_F [1]") if key == "load" else "χ [1]")
    return figure


@styled
def motion(
    stage: FloatArray,
    cycle: IntArray,
    measured: FloatArray,
    sigma: FloatArray,
    path: FloatArray,
    identified: Mapping[str, FloatArray],
    turning: IntArray,
) -> Figure:
    """Elongation and tilt over stage travel: free correlation, and the identified motion.

    Args:
        stage: stage travel at the images [µm], shape (T,).
        cycle: cycle of each image, shape (T,).
        measured: elongation and tilt of free correlation [µm], shape (T, 2).
        sigma: their standard deviations [µm], shape (2,).
        path: stage travel at all instants [µm], shape (n,).
        identified: elongation and tilt there [µm] of "before" (and "after"), each (n, 2).
        turning: the instants of the knots, shape (n_knots,).
    """
    figure = new_figure(3.9)
    sides = tuple(identified)
    names = side_labels(sides)
    titles = ("Elongation, U_Y(S⁺) − U_Y(S⁻)", "Tilt, U_Z(S⁺) − U_Z(S⁻)")
    for k, axis in enumerate(figure.subplots(1, 2)):
        value, spread = 1e3 * identified[sides[-1]][:, k], 1e3 * sigma[k]
        colour = SIDE_COLOURS[sides[-1]]
        for first, last in itertools.pairwise(turning):
            phase = slice(first, last + 1)
            axis.fill_between(path[phase], value[phase] - spread, value[phase] + spread,
                              color=colour, alpha=0.12, lw=0)  # fmt: skip
        for count, mark in zip(np.unique(cycle), itertools.cycle("os^v*"), strict=False):
            chosen = cycle == count
            axis.plot(stage[chosen], 1e3 * measured[chosen, k], mark, ms=3.4, color=GREY,
                      alpha=0.75, label=f"free correlation, cycle {count}")  # fmt: skip
        for side in sides:
            extra = ", ± σ of free correlation" if side == sides[-1] else ""
            axis.plot(path, 1e3 * identified[side][:, k], "--" if not extra else "-", lw=1.6,
                      color=SIDE_COLOURS[side], label=names[side] + extra)  # fmt: skip
        axis.plot(path[turning], value[turning], "D", ms=6, mfc="white", mec=colour, mew=1.6,
                  label="knots")  # fmt: skip
        axis.set(xlabel="stage travel [µm]", ylabel=("elongation [nm]", "tilt [nm]")[k],
                 title=typeset(titles[k]))  # fmt: skip
        grid(axis)
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure


@styled
def loads(
    stage: FloatArray,
    time: FloatArray,
    measured: FloatArray,
    predicted: Mapping[str, FloatArray],
    noise: float,
    initial: FloatArray,
) -> Figure:
    """Loops of the load over stage travel, and its residual over time.

    Args:
        stage: stage travel at the images [µm], shape (T,).
        time: time of the images [s], shape (T,).
        measured: measured load [µN], not a number where it is left out, shape (T,).
        predicted: load [µN] of "before" (and "after"), each of shape (T,).
        noise: standard deviation γ_F of the load [µN].
        initial: load with the parameters at the start [µN], shape (T,).
    """
    figure = new_figure(4.2)
    loop, residual = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    names = side_labels(tuple(predicted))
    loop.plot(stage, measured, "o", ms=3.5, mfc="none", mec=MEASURED, mew=0.9, label="measured")
    loop.plot(stage, initial, "-.", color=CYCLES[3], lw=1.3, label="at the start")
    for side, load in predicted.items():
        style = "--" if side == "before" and len(predicted) > 1 else "-"
        loop.plot(stage, load, style, color=SIDE_COLOURS[side], lw=1.4, label=names[side])
        residual.plot(time, measured - load, ".-", ms=4, lw=0.9, color=SIDE_COLOURS[side],
                      label=names[side])  # fmt: skip
    residual.axhspan(-noise, noise, color=GREY, alpha=0.25, lw=0,
                     label=typeset(f"± γ_F = {number(noise)} µN"))  # fmt: skip
    residual.axhline(0.0, color=GREY, lw=0.8)
    loop.set(xlabel="stage travel [µm]", ylabel="load on the specimen [µN]", title="Load loops")
    residual.set(xlabel="time [s]", ylabel="measured − model [µN]", title="Residual of the load")
    low, high = residual.get_ylim()
    residual.set_ylim(low, high + 0.2 * (high - low))
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    loop.set_ylim(bottom=min(0.0, low) - 0.22 * (high - low))
    loop.legend(loc="lower center", ncols=2, handlelength=2.0, columnspacing=1.2)
    residual.legend(loc="upper right", ncols=3, handlelength=1.4, columnspacing=1.0)
    for axis in (loop, residual):
        grid(axis)
    return figure


@styled
def residual_over_strain(
    strain: FloatArray,
    cycle: IntArray,
    loads: Mapping[str, FloatArray],
    images: Mapping[str, FloatArray],
) -> Figure:
    """Residual of the load and of the images over the strain of the face.

    Args:
        strain: identified elongation over the length [1], shape (T,).
        cycle: cycle of each image, shape (T,).
        loads: (measured − model)/γ_F of "before" (and "after"), each of shape (T,).
        images: rms of ρ/σ_ρ of each image, the same.
    """
    figure = new_figure(3.4)
    names = side_labels(tuple(loads))
    titles = ("Load", "Images")
    labels = (typeset("(measured − model)/γ_F [1]"), "rms of ρ/σ [1]")
    for k, axis in enumerate(figure.subplots(1, 2)):
        for side, values in (loads, images)[k].items():
            for count, mark in zip(np.unique(cycle), itertools.cycle("os^v*"), strict=False):
                chosen = cycle == count
                what = f"{names[side]}, cycle {count}"
                axis.plot(1e2 * strain[chosen], values[chosen], mark + "-", ms=3.2, lw=0.7,
                          color=SIDE_COLOURS[side], label=what)  # fmt: skip
        axis.axhline(float(k), color=GREY, lw=1.0, ls="--")
        axis.set(xlabel="strain [%]", ylabel=labels[k], title=titles[k])
        grid(axis)
    handles, texts = axis.get_legend_handles_labels()
    figure.legend(handles, texts, loc="outside lower center", ncols=3)
    return figure


@styled
def residual_history(
    time: FloatArray, free: FloatArray, sides: Mapping[str, FloatArray], peaks: IntArray
) -> Figure:
    """Residual of each image in units of noise over time.

    Args:
        time: time of the images [s], shape (T,).
        free: χ of free correlation, shape (T,).
        sides: rms of ρ/σ_ρ of "before" (and "after"), each of shape (T,).
        peaks: the images shown as maps.
    """
    figure = new_figure(2.7)
    axis = figure.subplots()
    names = side_labels(tuple(sides))
    axis.plot(time, free, ".-", ms=3.5, lw=0.8, color=CYCLES[0], label="free correlation")
    for side, rms in sides.items():
        axis.plot(time, rms, ".-", ms=3.5, lw=0.8, color=SIDE_COLOURS[side], label=names[side])
    axis.axhline(1.0, color=GREY, lw=1.0, ls="--")
    for peak in peaks:
        axis.axvline(time[peak], color=GREY, lw=0.8, ls=":")
    low, high = axis.get_ylim()
    axis.set_ylim(low, high + 0.18 * (high - low))
    axis.legend(loc="upper left", ncols=3)
    axis.set(xlabel="time [s]", ylabel="rms of ρ/σ [1]",
             title="Residual of each image; dotted lines: peaks of the cycles")  # fmt: skip
    grid(axis)
    return figure

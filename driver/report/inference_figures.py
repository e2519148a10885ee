"""Figures of the inference: evidence of the causes, correlation and convergence of parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from driver.diagnosis.diagnose import WITHIN
from driver.report.style import (
    AFTER,
    BEFORE,
    CATEGORIES,
    CYCLES,
    GREY,
    MEASURED,
    SIGNED,
    WIDTH,
    grid,
    new_figure,
    styled,
    typeset,
)

FloatArray = NDArray[np.float64]

_LINEAR = 10.0  # of the evidence axis; logarithmic beyond
_WRITTEN = 0.7  # correlations beyond which the value is written


@styled
def evidence(
    names: Sequence[str],
    categories: Sequence[str],
    score: FloatArray,
    refit: FloatArray,
) -> Figure:
    """Log evidence of every cause against the baseline of a round, best on top.

    Args:
        names: the causes, best first, length n.
        categories: their categories.
        score: log evidence of the first-order screening, shape (n,).
        refit: log evidence of the refit, NaN where there is none, shape (n,).
    """
    n = len(names)
    figure = new_figure(0.255 * n + 1.15)
    axis = figure.subplots()
    best = np.where(np.isnan(refit), score, refit)
    winner = int(np.nanargmax(refit)) if not np.all(np.isnan(refit)) else None
    if winner is not None and refit[winner] <= 0:
        winner = None
    places = np.arange(n)
    for place, category in enumerate(categories):
        colour, refitted = CATEGORIES[category], not np.isnan(refit[place])
        axis.barh(place, best[place], height=0.72, color=colour, alpha=1.0 if refitted else 0.45,
                  edgecolor=MEASURED if place == winner else colour,
                  lw=2.0 if place == winner else 0.6)  # fmt: skip
        if refitted:
            axis.plot(score[place], place, "D", ms=5, mfc="white", mec=MEASURED, mew=1.0)
        text = signed_evidence(best[place])
        axis.annotate(text, (max(best[place], score[place] if refitted else -np.inf, 0.0), place),
                      xytext=(7, 0), textcoords="offset points", va="center", fontsize=8.5,
                      weight="bold" if place == winner else "normal",
                      bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 0.6})  # fmt: skip
    axis.axvline(0.0, color=MEASURED, lw=0.9)
    if winner is not None:
        axis.axvline(refit[winner] - WITHIN, color=BEFORE, lw=1.1, ls="--")
    largest = max(float(np.nanmax(np.abs(best))), float(np.abs(score).max()))
    if largest > 6 * _LINEAR:
        axis.set_xscale("symlog", linthresh=_LINEAR, linscale=1.0)
        axis.set_xlim(min(-1.0, 1.3 * float(best.min())), 3.5 * largest)
        note = f" (linear to ±{_LINEAR:g}, logarithmic beyond)"
    else:
        low = min(float(best.min()), 0.0)
        axis.set_xlim(low - 0.5, largest + 0.16 * (largest - low) + 0.5)
        note = ""
    axis.set_yticks(places, names)
    axis.set_ylim(n - 0.4, -0.6)
    if winner is not None:
        axis.get_yticklabels()[winner].set_fontweight("bold")
    axis.set_xlabel(f"log evidence against the model of this round{note}")
    axis.tick_params(axis="y", length=0)
    axis.grid(True, axis="x")
    axis.legend(handles=_evidence_key(categories, winner is not None), loc="lower right",
                frameon=True, framealpha=0.95)  # fmt: skip
    return figure


def signed_evidence(value: float) -> str:
    """A log evidence with its sign, to one decimal place below a hundred."""
    return f"{value:+.{1 if abs(value) < 100 else 0}f}".replace("-", "−")


def _evidence_key(categories: Sequence[str], refitted: bool) -> list[Patch | Line2D]:
    key: list[Patch | Line2D] = [
        Patch(color=colour, label=name) for name, colour in CATEGORIES.items() if name in categories
    ]
    key.append(Patch(color=GREY, alpha=0.45, label="screened only (pale)"))
    if refitted:
        key.append(Line2D([], [], marker="D", ls="", mfc="white", mec=MEASURED,
                          label="its screening, before the refit"))  # fmt: skip
        key.append(Line2D([], [], color=BEFORE, ls="--", label=f"best − {WITHIN:g}"))
    return key


@styled
def correlation(names: Sequence[str], matrix: FloatArray) -> Figure:
    """Correlation matrix of the identified parameters; strong ones with their value.

    Args:
        names: the parameters, length k.
        matrix: shape (k, k).
    """
    k = len(names)
    side = min(WIDTH - 0.3, max(4.2, 0.34 * k + 1.9))
    figure = new_figure(0.88 * side, side + 0.3)
    axis = figure.subplots()
    picture = axis.imshow(matrix, cmap=SIGNED, vmin=-1.0, vmax=1.0)
    for row, column in np.argwhere(np.abs(matrix) >= _WRITTEN):
        if row != column:
            text = f"{matrix[row, column]:.2f}".replace("-", "−").replace("0.", ".")
            axis.text(column, row, text, ha="center", va="center", color="white", fontsize=7.0)
    written = [typeset(name) for name in names]
    axis.set_xticks(range(k), written, rotation=90)
    axis.set_yticks(range(k), written)
    axis.tick_params(length=0, labelsize=8.5, pad=6)
    for spine in axis.spines.values():
        spine.set_visible(False)
    axis.set_xticks(np.arange(k + 1) - 0.5, minor=True)
    axis.set_yticks(np.arange(k + 1) - 0.5, minor=True)
    axis.tick_params(which="minor", length=0)
    axis.grid(True, which="minor", color="white", lw=1.0)
    figure.colorbar(picture, ax=axis, shrink=0.75, label="correlation [1]")
    return figure


@styled
def convergence(
    chi_image: Sequence[FloatArray],
    chi_load: Sequence[FloatArray],
    stages: Sequence[str],
    values: Mapping[str, Sequence[FloatArray]],
) -> Figure:
    """χ and parameters over the iterations of the stages of an identification.

    Args:
        chi_image: χ of the images on the correlation mesh, one array for each stage.
        chi_load: χ_F, NaN in a stage without loads.
        stages: names of the stages.
        values: by label, parameters over their last value, NaN where held, one array a stage.
    """
    figure = new_figure(5.0)
    upper, lower = figure.subplots(2, 1, sharex=True)
    ends = np.cumsum([0, *(len(chi) for chi in chi_image)])
    at = np.arange(ends[-1])
    upper.semilogy(at, np.concatenate(list(chi_load)), "s-", ms=4, lw=1.2, color=BEFORE,
                   label=typeset("χ_F (loads)"))  # fmt: skip
    upper.semilogy(at, np.concatenate(list(chi_image)), "o-", ms=4, lw=1.2, color=AFTER,
                   label="χ (images, correlation mesh)")  # fmt: skip
    colours = (*CYCLES, AFTER, BEFORE, MEASURED)
    for index, (name, parts) in enumerate(values.items()):
        lower.plot(at, np.concatenate(list(parts)), ".-", ms=5, lw=1.1,
                   color=colours[index % len(colours)], label=name)  # fmt: skip
    upper.axhline(1.0, color=GREY, lw=1.0, ls="--")
    lower.axhline(1.0, color=GREY, lw=1.0, ls="--")
    for k, name in enumerate(stages):
        for axis in (upper, lower):
            axis.axvspan(ends[k] - 0.5, ends[k + 1] - 0.5, color=GREY, lw=0,
                         alpha=0.10 if k % 2 else 0.0)  # fmt: skip
        upper.text((ends[k] + ends[k + 1] - 1) / 2, 1.0, name, ha="center", va="bottom",
                   transform=upper.get_xaxis_transform(), weight="bold", fontsize=9)  # fmt: skip
    upper.set(ylabel="χ [1]", xlim=(-0.5, ends[-1] - 0.5))
    lower.set(ylabel="value / last value [1]", xlabel="iteration")
    for axis in (upper, lower):
        grid(axis)
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure

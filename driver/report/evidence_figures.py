"""Evidence of every cause, as bars."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from driver.diagnosis.search.selection_round import WITHIN
from driver.report.style import (
    BEFORE,
    CATEGORIES,
    GREY,
    MEASURED,
    new_figure,
    styled,
)
from meshes.arrays import FloatArray

_LINEAR = 10.0  # of the evidence axis; logarithmic beyond


@styled
def evidence(
    names: Sequence[str],
    categories: Sequence[str],
    score: FloatArray,
    refit: FloatArray,
    winner: int | None,
) -> Figure:
    """Log evidence of every cause against the baseline of a round, best on top.

    Args:
        names: the causes, best first, length n.
        categories: their categories.
        score: log evidence of the first-order screening, shape (n,).
        refit: log evidence of the refit, NaN where there is none, shape (n,).
        winner: the place of the cause that the round added, None where it added none.
    """
    n = len(names)
    figure = new_figure(0.255 * n + 1.15)
    axis = figure.subplots()
    best = np.where(np.isnan(refit), score, refit)
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
    """Return a log evidence with its sign, to one decimal place below a hundred."""
    return f"{value:+.{1 if abs(value) < 100 else 0}f}".replace("-", "−")


def _evidence_key(categories: Sequence[str], refitted: bool) -> list[Patch | Line2D]:
    key: list[Patch | Line2D] = [
        Patch(color=colour, label=name) for name, colour in CATEGORIES.items() if name in categories
    ]
    key.append(Patch(color=GREY, alpha=0.45, label="screened only (pale)"))
    if refitted:
        key.append(Line2D([], [], marker="D", ls="", mfc="white", mec=MEASURED,
                          label="its screening, before the refit"))  # fmt: skip
        key.append(Line2D([], [], color=BEFORE, ls="--", label=f"added − {WITHIN:g}"))
    return key

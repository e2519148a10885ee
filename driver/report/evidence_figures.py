"""Evidence of every cause, as bars."""

from __future__ import annotations

from collections.abc import Collection, Sequence

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

_SHOWN = 40.0  # of log evidence behind the best, at least; what lies farther is cut off
_PALE, _FAINT = 0.45, 0.12  # of bars that are screened only, and of those that are cut off
_BEYOND_NEXT = 3.0  # times the lead over the next cause that are shown


@styled
def evidence(
    names: Sequence[str],
    categories: Sequence[str],
    score: FloatArray,
    refit: FloatArray,
    winner: int | None,
    less_corrected: Collection[int] = (),
) -> Figure:
    """Log evidence of every cause on a linear axis: how far it is behind the added one.

    Where none was added it is the evidence against the model of the round. What lies too far
    below to be compared is cut off and marked.

    Args:
        names: the causes, best first, length n.
        categories: their categories.
        score: log evidence of the first-order screening, shape (n,).
        refit: log evidence of the refit, NaN where there is none, shape (n,).
        winner: the place of the cause that the round added, None where it added none.
        less_corrected: places of refits whose correction was taken farther from their end.
    """
    n = len(names)
    figure = new_figure(0.255 * n + 1.45)
    axis = figure.subplots()
    best = np.where(np.isnan(refit), score, refit)
    behind = best - (0.0 if winner is None else best[winner])
    low, high = _window(behind, winner)
    for place, category in enumerate(categories):
        colour, cut_off = CATEGORIES[category], behind[place] < low
        outlined = place in less_corrected
        faint = _PALE if outlined else _FAINT  # of an outline less would be nothing
        alpha = faint if cut_off else _PALE if np.isnan(refit[place]) else 1.0
        axis.barh(place, max(behind[place], low), height=0.72, color=colour, alpha=alpha,
                  edgecolor=MEASURED if place == winner else colour,
                  lw=2.0 if place == winner else 0.6,
                  fill=not outlined)  # fmt: skip
        if cut_off:
            axis.plot(low, place, "<", ms=6, color=MEASURED, clip_on=False)
        text = signed_evidence(best[place])
        if winner is not None:
            text += " (added)" if place == winner else f" ({signed_evidence(behind[place])})"
        axis.annotate(text, (max(behind[place], 0.0), place), xytext=(7, 0),
                      textcoords="offset points", va="center", fontsize=8.5,
                      weight="bold" if place == winner else "normal",
                      bbox={"facecolor": "white", "alpha": 0.85, "lw": 0, "pad": 0.6})  # fmt: skip
    axis.axvline(0.0, color=MEASURED, lw=0.9)
    if winner is not None:
        axis.axvline(-WITHIN, color=BEFORE, lw=1.1, ls="--")
    axis.set_xlim(low - 0.015 * (high - low), high + 0.22 * (high - low))
    axis.set_yticks(places := np.arange(n), names)
    axis.set_ylim(places[-1] + 0.6, -0.6)
    if winner is None:
        axis.set_xlabel("log evidence against the model of this round")
    else:
        axis.get_yticklabels()[winner].set_fontweight("bold")
        axis.set_xlabel(f"log evidence less that of {names[winner]}")
    axis.tick_params(axis="y", length=0)
    axis.grid(True, axis="x")
    cut = bool((behind < low).any())
    handles = _evidence_key(categories, winner is not None, cut, bool(less_corrected))
    figure.legend(handles=handles, loc="outside lower center", ncols=4)
    return figure


def _window(behind: FloatArray, winner: int | None) -> tuple[float, float]:
    """Return the ends of the axis: the lead over the next cause fills a good part of it."""
    high = max(float(behind.max()), 0.0)
    if winner is None:
        return max(float(behind.min()), -_SHOWN, -max(high, 1.0)), max(high, 0.5)
    others = np.delete(behind, winner)
    lead = -float(others.max()) if others.size else 0.0
    return max(float(behind.min()), -max(_SHOWN, _BEYOND_NEXT * lead)), high


def signed_evidence(value: float) -> str:
    """Return a log evidence with its sign, to one decimal place below a hundred."""
    return f"{value:+.{1 if abs(value) < 100 else 0}f}".replace("-", "−")


def _evidence_key(
    categories: Sequence[str], added: bool, cut: bool, outlined: bool
) -> list[Patch | Line2D]:
    key: list[Patch | Line2D] = [
        Patch(color=colour, label=name) for name, colour in CATEGORIES.items() if name in categories
    ]
    key.append(Patch(color=GREY, alpha=_PALE, label="screened only (pale)"))
    if outlined:
        label = "corrected farther from its end"
        key.append(Patch(edgecolor=GREY, fill=False, label=label))
    if cut:
        key.append(Line2D([], [], marker="<", ls="", color=MEASURED, label="farther below"))
    if added:
        key.append(Line2D([], [], color=BEFORE, ls="--", label=f"{WITHIN:g} behind"))
    return key

"""Picture of the critical stress along the grains in which it varies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from driver.report.maps import GRAINS
from driver.report.style import CYCLES, grid, new_figure, styled

_SIGMAS = 2.0  # half of the band of uncertainty, in standard deviations


@styled
def critical_stress(along: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Figure:
    """Critical stress along grains over that without modes and band, with its uncertainty.

    Args:
        along: entries of `critical_stress` of `diagnosis.json`.
        names: of all grains.
    """
    figure = new_figure(3.2)
    axes = figure.subplots()
    for grain in along:
        number = grain["grain"] - 1
        y, ratio, sigma = (np.array(grain[key]) for key in ("y_um", "ratio", "sigma"))
        low, high = ratio - _SIGMAS * sigma, ratio + _SIGMAS * sigma
        shade, colour = GRAINS[number % len(GRAINS)], CYCLES[number % len(CYCLES)]
        axes.fill_between(y, low, high, color=shade, alpha=0.5, linewidth=0)
        axes.plot(y, ratio, color=colour, linewidth=2.0, label=names[number])
    axes.axhline(1.0, color="black", linewidth=0.8)
    axes.set_xlabel("Y [µm]")
    axes.set_ylabel("factor on critical stress [1]")
    axes.legend()
    grid(axes)
    return figure

"""What a change of an experiment would buy: two forecasts side by side."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from driver.design.forecast import Forecast
from driver.design.information import groups_of
from driver.diagnosis.statistics.score_test import PARALLEL
from driver.results.design import Gain, Pair

_TOLD = 0.9  # cosine below which a change is said to part two causes that were parallel


def gain(before: Forecast, after: Forecast) -> Gain:
    """Return what a change does to all that both experiments have in common."""
    theta = {p.name: p.theta for p in before.parameters}
    old = {c.cause.name: c.in_scales for c in before.causes}
    new = {c.cause.name: c.in_scales for c in after.causes}
    common = [name for name in old if name in new]
    angle, angle_now = _cosines(before), _cosines(after)
    both = [pair for pair in angle if pair in angle_now]
    return Gain(
        sigma={p.name: _ratio(theta[p.name], p.theta) for p in after.parameters if p.name in theta},
        seen={name: _ratio(old[name], new[name]) for name in common},
        parted=tuple(p for p in both if angle_now[p] <= _TOLD < PARALLEL < angle[p]),
        merged=tuple(p for p in both if angle[p] <= _TOLD < PARALLEL < angle_now[p]),
        shown=tuple(name for name in common if new[name] <= 1.0 < old[name]),
        lost=tuple(name for name in common if old[name] <= 1.0 < new[name]),
    )


def pairs(forecast: Forecast) -> tuple[Pair, ...]:
    """Causes that could not be told apart, each pair once, in the order of the alphabet."""
    return tuple(pair for pair, angle in _cosines(forecast).items() if angle > PARALLEL)


def _cosines(forecast: Forecast) -> dict[Pair, float]:
    """Cosine of each pair of causes, in the order of the alphabet."""
    cosines = {
        (outlook.cause.name, other): angle
        for outlook in forecast.causes
        for other, angle in outlook.cosines.items()
        if outlook.cause.name < other
    }
    return dict(sorted(cosines.items()))


def by_group(ratios: Mapping[str, float]) -> dict[str, float]:
    """Geometric mean of ratios over the parameters that belong together."""
    return {
        group: float(np.exp(np.mean([np.log(ratios[name]) for name in members])))
        for group, members in groups_of(tuple(ratios)).items()
        if all(0.0 < ratios[name] < np.inf for name in members)
    }


def _ratio(before: float, after: float) -> float:
    if np.isfinite(before) and np.isfinite(after):
        return after / before
    return 1.0 if not np.isfinite(after) and not np.isfinite(before) else after / before

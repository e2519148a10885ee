"""Which causes would show: by the score of the diagnosis, with data that hold nothing yet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from driver.design.information import groups_of
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.bayes_factor import prior_scaled
from driver.diagnosis.statistics.score_test import (
    SEEN_AT,
    Score,
    score,
    subspace_similarity,
)
from driver.identification.objective import Evaluation
from driver.results.design import Outlook, Visible
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

NAMED_AT = 6.0
"""Projected misfit [σ] from which a cause is named rightly in 19 of 20 cases, if not alone in its
class then as one of it: measured on a surrogate with 30 causes. It is seen from `SEEN_AT` on."""


def outlooks(
    causes: Sequence[Cause],
    augmented: Evaluation,
    fitted: Evaluation,
    parameters: Mapping[str, Parameter],
) -> tuple[Outlook, ...]:
    """Return what would become of each cause.

    Args:
        causes: the causes.
        augmented: expected evaluation with the parameters of every cause free.
        fitted: the same with the fitted parameters alone.
        parameters: declarations by name.
    """
    scored_causes: list[tuple[Score, tuple[Visible, ...]]] = []
    for cause in causes:
        rows = [augmented.free.index(name) for name in cause.parameters]
        effect = prior_scaled(augmented.jacobian[rows], cause.parameters, parameters)
        scored = score(cause, effect, fitted, len(causes))
        scored_causes.append((scored, _visible(scored, effect, fitted, parameters)))
    return tuple(
        Outlook(
            scored.cause,
            visible,
            {
                other.cause.name: subspace_similarity(scored, other)
                for other, _ in scored_causes
                if other is not scored
            },
        )
        for scored, visible in scored_causes
    )


def _visible(
    scored: Score, effect: FloatArray, fitted: Evaluation, parameters: Mapping[str, Parameter]
) -> tuple[Visible, ...]:
    coupling = np.linalg.solve(fitted.hessian, fitted.jacobian @ effect.T)
    projected = effect - coupling.T @ fitted.jacobian
    energy, whole = np.sum(projected**2, axis=1), np.sum(effect**2, axis=1)
    limits = []
    for i, name in enumerate(scored.cause.parameters):
        parameter, seen = parameters[name], float(scored.visible[i])
        hidden_by, factor = _hidden_by(effect[i], fitted)
        nothing = not np.isfinite(seen)
        limits.append(
            Visible(
                name=name,
                unit=parameter.unit if not parameter.logarithmic else "",
                relative=parameter.logarithmic,
                scale=parameter.scale,
                sigma=seen / SEEN_AT * parameter.scale,
                seen=seen * parameter.scale,
                named=seen * NAMED_AT / SEEN_AT * parameter.scale,
                left=0.0 if nothing else float((SEEN_AT / seen) / np.sqrt(whole[i])),
                loads=0.0 if nothing else float(_loads(projected[i], fitted.n_load, energy[i])),
                hidden_by=hidden_by,
                factor=factor,
            )
        )
    return tuple(limits)


def _loads(projected: FloatArray, n_load: int, energy: float) -> float:
    return float(np.sum(projected[:n_load] ** 2)) / energy if energy > 0 else 0.0


def _hidden_by(effect: FloatArray, fitted: Evaluation) -> tuple[str, float]:
    """Return the fitted group that takes most of an effect, and what knowing it would do."""
    hessian, along = fitted.hessian, fitted.jacobian @ effect
    whole = float(effect @ effect)

    def left(kept: Sequence[int]) -> float:
        inner = along[kept] @ np.linalg.solve(hessian[np.ix_(kept, kept)], along[kept])
        return max(whole - float(inner), 0.0)

    everything = range(len(fitted.free))
    now, best, least = left(list(everything)), "", 1.0
    for group, members in groups_of(fitted.free).items():
        kept = [i for i in everything if fitted.free[i] not in members]
        known = left(kept)
        factor = float(np.sqrt(now / known)) if known > 0 else 1.0
        if factor < least:
            best, least = group, factor
    return best, least

"""Which added measurement would part causes that data cannot tell apart, by their sensitivities.

For two causes of likeness l, the smaller found to have a projected misfit of s σ, the other one
would leave s √(1 − l²) σ unexplained: that is by how much an experiment tells them apart.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import sqrt
from pathlib import Path

from driver.case.model import CASE_FILE, Case
from driver.design.command import changed_forecasts
from driver.design.forecast import Forecast, Plan, forecast, prepare, simulate
from driver.design.settings import Settings
from driver.design.surface import expected_surface
from driver.design.variants import base_variant, usual_changes, variants
from driver.diagnosis.statistics.score_test import SEEN_AT
from driver.experiment.history import History


@dataclass(frozen=True)
class Discrimination:
    """An experiment and how far it would part a set of causes.

    Attributes:
        name: the change of the experiment in a few words; empty for the experiment as it was.
        apart: smallest unexplained misfit between two causes of the set [σ].
    """

    name: str
    apart: float


def discriminating_changes(
    case: Case,
    history: History,
    sizes: Mapping[str, float],
    values: Mapping[str, float],
    jobs: Path | None = None,
) -> tuple[Discrimination, ...]:
    """How far each of the usual changes of an experiment would part a set of causes.

    Args:
        case: the case.
        history: of its test.
        sizes: how large each cause of the set was found [prior scales].
        values: parameters at which the model is linearised.
        jobs: folder of the jobs of a solver that is a program of its own, or None.

    Returns:
        The experiment as it was, then the changes, the one that parts them most first.

    Raises:
        InputError: a file of the case cannot be used.
        SolverError: the experiment could not be simulated.
    """
    table = case.diagnosis.model_copy(update={"causes": tuple(sizes)})
    case = case.model_copy(update={"diagnosis": table})
    settings = Settings(truth=dict(values))
    surface = expected_surface(case, settings, history)
    base = Plan(base_variant(case, settings), history, surface, settings, jobs)
    usual = usual_changes(case, settings.test, surface.images.n_reference)
    plans = [
        replace(base, variant=variant)
        for variant in variants(base.variant, usual, {}, [], case.path(CASE_FILE))
    ]
    prepared = prepare(base)
    simulated = simulate(prepared)
    before = forecast(prepared, simulated)
    others = changed_forecasts(plans, base, simulated)
    changes = [Discrimination(other.variant.name, apart(other, sizes)) for other in others]
    changes.sort(key=lambda change: -change.apart)
    return (Discrimination("", apart(before, sizes)), *changes)


def apart(expected: Forecast, sizes: Mapping[str, float]) -> float:
    """Smallest misfit that one cause of a set would leave of another one [σ]."""
    outlooks = {o.cause.name: o for o in expected.causes if o.cause.name in sizes}
    misfit = {name: sizes[name] * SEEN_AT / o.in_scales for name, o in outlooks.items()}
    return min(
        (
            min(misfit[a], misfit[b]) * sqrt(max(1.0 - outlooks[a].cosines[b] ** 2, 0.0))
            for a, b in combinations(outlooks, 2)
        ),
        default=0.0,
    )


def advice(found: Sequence[Discrimination]) -> str:
    """Return what to measure, in a sentence."""
    now, best = found[0], found[1]
    if best.apart < max(2.0 * now.apart, 1.0):
        return (
            "None of the usual changes of the experiment would part them "
            f"(the best, {best.name}: {best.apart:.1f} σ)."
        )
    return (
        f"Of the usual changes of the experiment, {best.name} would part them best: "
        f"by {best.apart:.1f} σ, against {now.apart:.1f} σ now."
    )

"""Blind trials of a specimen with a solver in closed form: how often its rules alone err.

    python -m benchmarks.blind_closed_form       as many as the goals need, on all cores
    python -m benchmarks.blind_trial --quick     those of 32 CPU-s

Diagnosis and fits are the real ones; mesh, time steps and correlation have no part in it.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.blind_figures import show_share
from benchmarks.blind_ruler import MOST_SCALES
from driver.common import machine
from driver.common.parallel import side_by_side
from driver.diagnosis.answer.result_types import Diagnosis
from driver.identification.fit import Fit
from driver.identification.objective import Objective
from solver_adapters.parameter import Parameter
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

BUDGET = 32.0  # CPU-s, after which no further trial of the quick ones starts
LEVEL = 8.0  # projected misfit of a hidden effect [σ]
SHARE_OF_NULLS = 4  # one of the quick trials in so many
NULLS, EFFECTS = 800, 400  # 765 nulls without a name bound false names by 0.5 %
SEED = 7
ITERATIONS, TOLERANCE = 12, 0.05  # with which an effect of that misfit is found
BENCH = closed_form.problem()
FIVE = replace(SETTINGS, refit=5)


@dataclass(frozen=True)
class Outcome:
    """What one trial came to.

    Attributes:
        hidden: parameter and value; empty where nothing is hidden.
        cause: the one that is hidden; empty where nothing is.
        verdict: its kind.
        names: of the causes in the answer.
        statistic: of the hidden cause in the first round; 0 where nothing is hidden.
        cpu: time of the trial [s].
    """

    hidden: str
    cause: str
    verdict: str
    names: tuple[str, ...]
    statistic: float
    cpu: float


def main() -> None:
    """Run all trials and print their figures."""
    tasks = [*(("null", k) for k in range(NULLS)), *(("effect", k) for k in range(EFFECTS))]
    _show(side_by_side(trial, tasks, machine.cores()))


def quick() -> None:
    """Trials in turn without and with an effect, until the time is over."""
    began, outcomes = time.process_time(), list[Outcome]()
    while time.process_time() - began < BUDGET:
        index = len(outcomes)
        silent = index % SHARE_OF_NULLS == 0
        outcomes.append(trial(("null" if silent else "effect", index)))
    _show(outcomes)


def trial(task: tuple[str, int]) -> Outcome:
    """Return the outcome of one trial, which draws from a stream of its own.

    Args:
        task: "null" or "effect", and a number.
    """
    kind, index = task
    rng = np.random.default_rng([SEED, kind == "effect", index])
    cause, hidden = "", {}
    if kind == "effect":
        of_size = _effects()
        cause = str(rng.choice(list(of_size)))
        parameter, sides = of_size[cause]
        hidden = {parameter: float(rng.choice(sides))}
    began = time.process_time()
    found = _diagnosed(hidden, int(rng.integers(2**31)))
    statistics = {s.cause.name: s.statistic for s in found.rounds[0].scores}
    return Outcome(
        ", ".join(f"{name} = {value:g}" for name, value in hidden.items()),
        cause,
        found.verdict.kind,
        found.verdict.names,
        statistics.get(cause, 0.0),
        time.process_time() - began,
    )


def _show(outcomes: Sequence[Outcome]) -> None:
    nulls = [o for o in outcomes if not o.cause]
    loud = [o for o in outcomes if o.cause]
    for o in outcomes:
        if (o.cause not in o.names) if o.cause else o.verdict != "nothing wrong":
            said = f"{o.verdict}, {', '.join(o.names) or 'no cause'}"
            print(f"miss: {o.hidden or 'nothing'}: {said}; statistic {o.statistic:.1f}")
    print(f"closed form: {len(_effects())} causes, each of {LEVEL:g} σ")
    named = [bool(o.names) for o in nulls]
    show_share("closed form, null: something named [%]", named, "<= 0.5")
    silent = [o.verdict == "nothing wrong" for o in nulls]
    show_share("closed form, null: nothing wrong [%]", silent, ">= 97")
    right = [o.cause in o.names for o in loud]
    show_share("closed form, hidden effect: the answer holds it [%]", right, ">= 97")
    alone = [o.names == (o.cause,) for o in loud]
    show_share("closed form, hidden effect: it alone is the answer [%]", alone, "none")
    cpu = sum(o.cpu for o in outcomes)
    mean = cpu / len(outcomes)
    print(f"closed form: CPU time of a trial [s] = {mean:.2f}, of all = {cpu:.0f} (goal: none)")


def _diagnosed(hidden: dict[str, float], seed: int) -> Diagnosis:
    made = closed_form.objective(BENCH, BENCH.truth | hidden, seed)
    return diagnosis_of(BENCH, identified(BENCH, made), FIVE)


@cache
def _effects() -> dict[str, tuple[str, list[float]]]:
    """By cause its parameter, and the values of it that leave a misfit of `LEVEL`.

    A value that would need more prior scales than a trial with the specimen may hide, or that
    bounds keep from that size, is not hidden here either, nor is a cause of several parameters.
    """
    null = _diagnosed({}, SEED)
    objective, fitted = null.baseline_objective, null.baseline
    effects = {}
    for cause in (score.cause for score in null.rounds[0].scores):
        if len(cause.parameters) > 1 or cause.parameters[0] not in objective.parameters:
            continue
        p = objective.parameters[cause.parameters[0]]
        signs = (1.0,) if cause.one_sided else (1.0, -1.0)
        found = [_of_size(objective, fitted, p, sign) for sign in signs]
        values = [value for value in found if value is not None]
        if values:
            effects[cause.name] = (p.name, values)
    return effects


def _of_size(objective: Objective, fitted: Fit, p: Parameter, sign: float) -> float | None:
    """Value of a parameter on one side of its null that leaves a misfit of `LEVEL`."""
    theta, null = 0.1 * sign * p.width, BENCH.truth[p.name]
    for _ in range(ITERATIONS):
        value = p.value(theta, null)
        misfit = _misfit(objective, fitted, {p.name: value})
        if abs(misfit - LEVEL) < TOLERANCE * LEVEL:
            return value
        if misfit == 0.0:
            return None
        theta = sign * min(abs(theta) * LEVEL / misfit, MOST_SCALES * p.width)
    return None


def _misfit(objective: Objective, fitted: Fit, hidden: dict[str, float]) -> float:
    """Return what an effect leaves beside the fitted parameters [σ], linear or not."""
    model, best = objective.model, fitted.best
    bare, other = (model.predict(BENCH.truth | values) for values in ({}, hidden))
    change = objective.data.change(other.motion - bare.motion, other.load - bare.load)
    shift = np.linalg.solve(best.hessian, best.jacobian @ change)
    return float(np.linalg.norm(change - best.jacobian.T @ shift))


if __name__ == "__main__":
    main()

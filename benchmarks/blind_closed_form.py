"""Blind trials of a specimen with a solver in closed form: some seconds, and no guarantee.

Diagnosis and fits are the real ones; mesh, time steps and correlation have no part in it.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from benchmarks.blind_figures import show_share
from benchmarks.blind_ruler import MOST_SCALES
from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.statistics.score_test import SEEN_AT
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

BUDGET = 32.0  # CPU-s, after which no further trial starts
LEVEL = 8.0  # projected misfit of a hidden effect [σ]
SHARE_OF_NULLS = 4  # one trial in so many
BENCH = closed_form.problem()
FIVE = replace(SETTINGS, refit=5)


def quick(seed: int = 7) -> None:
    """Trials in turn without and with an effect of one parameter, until the time is over.

    The first, without an effect, tells how large each effect has to be. One that would need more
    prior scales than a trial with the specimen may hide is not hidden here either.
    """
    rng, began = np.random.default_rng(seed), time.process_time()
    first = _diagnosed({}, rng)
    of_size = _effects(first)
    silent, named = [_is_silent(first)], [bool(first.verdict.names)]
    right: list[bool] = []
    alone: list[bool] = []
    while time.process_time() - began < BUDGET:
        if (len(silent) + len(right)) % SHARE_OF_NULLS == 0:
            diagnosis = _diagnosed({}, rng)
            silent.append(_is_silent(diagnosis))
            named.append(bool(diagnosis.verdict.names))
            continue
        cause = str(rng.choice(list(of_size)))
        parameter, sides = of_size[cause]
        value = float(rng.choice(sides))
        diagnosis = _diagnosed({parameter: value}, rng)
        answer = diagnosis.verdict.names
        right.append(cause in answer)
        alone.append(answer == (cause,))
        if not right[-1]:
            outcome = f"{diagnosis.verdict.kind}, {', '.join(answer) or 'no cause'}"
            statistic = next(
                s.statistic for s in diagnosis.rounds[0].scores if s.cause.name == cause
            )
            print(f"miss: {parameter} = {value:g}: {outcome}; its statistic {statistic:.1f}")
    n = len(silent) + len(right)
    print(f"closed form: {len(of_size)} causes, each of {LEVEL:g} σ")
    show_share("closed form, null: something named [%]", named, "<= 1")
    show_share("closed form, null: anything said [%]", [not quiet for quiet in silent], "<= 2.5")
    show_share("closed form, hidden effect: the answer holds it [%]", right, ">= 98")
    show_share("closed form, hidden effect: it alone is the answer [%]", alone, "none")
    cpu = time.process_time() - began
    print(f"closed form: CPU time of a trial [s] = {cpu / n:.2f}, of all = {cpu:.0f} (goal: <= 45)")


def _diagnosed(hidden: dict[str, float], rng: np.random.Generator) -> Diagnosis:
    made = closed_form.objective(BENCH, BENCH.truth | hidden, int(rng.integers(2**31)))
    return diagnosis_of(BENCH, identified(BENCH, made), FIVE)


def _is_silent(found: Diagnosis) -> bool:
    return found.verdict.kind == "nothing wrong"


def _effects(null: Diagnosis) -> dict[str, tuple[str, list[float]]]:
    """By cause its parameter, and the values of it that leave a misfit of `LEVEL`."""
    parameters, effects = null.objective.parameters, {}
    for score in null.rounds[0].scores:
        cause = score.cause
        if len(cause.parameters) > 1 or cause.parameters[0] not in parameters:
            continue
        size = LEVEL / SEEN_AT * float(score.visible[0])
        if size > MOST_SCALES:
            continue
        p = parameters[cause.parameters[0]]
        theta = size * p.width
        sides = [theta] if cause.one_sided else [theta, -theta]
        null_value = BENCH.truth[p.name]
        effects[cause.name] = (p.name, [p.value(side, null_value) for side in sides])
    return effects

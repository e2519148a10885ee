from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast
from unittest.mock import patch

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search import candidate_selection, selection_round
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.finite_step_score import FiniteStepScores
from driver.diagnosis.search.flip_trial import FlipTrial
from driver.diagnosis.search.refit import Executor
from driver.diagnosis.search.selection_round import WITHIN, examine, set_of
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, WORTH, Score
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, finer, identified

BENCH = closed_form.problem()
EVERY = replace(SETTINGS, refit=5)
TILT = replace(EVERY, wanted=("tilt_drift",))
NO_STOPS = BoundaryNoiseSensitivities(None)
FINER = FineModels(finer(BENCH))


def tilting() -> tuple[Objective, Fit]:
    return identified(BENCH, closed_form.objective(BENCH, BENCH.truth | {"tilt_drift": 4e-4}))


def test_of_a_small_effect_that_its_cause_explains_no_other_cause_is_refitted() -> None:
    objective, baseline = tilting()
    found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER)
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    assert len(found.round_.refits) == 1


def test_where_loads_are_far_off_all_causes_are_tried_though_none_is_significant(
    lines: list[str],
) -> None:
    objective, baseline = tilting()
    with (
        patch.object(candidate_selection, "LARGE", 0.1),
        patch.object(candidate_selection, "NAMING_LEVEL", 1e-300),
    ):
        found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER)
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    tried = next(line for line in lines if line.startswith("a large effect"))
    hopeless = next(line for line in lines if "the first step promises too little of" in line)
    others = {s.cause.name for s in found.round_.scores if s.degrees} - {"tilt_drift"}
    refitted = {refit.cause.name for refit in found.round_.refits}
    seen = {name for name in others if name in tried and (name in hopeless or name in refitted)}
    assert len(seen) > 20 and others - seen <= {"discretisation", "boundary_noise"}


def test_an_effect_far_beyond_its_prior_is_significant_and_still_not_added() -> None:
    objective, baseline = tilting()
    found = examine(baseline, objective, (), TILT, NO_STOPS, None, FINER)
    assert found.winner is not None and found.winner.cause.name == "tilt_drift"
    usual = objective.parameters["tilt_drift"]
    # Of this size nobody expects it: four hundred of its prior scales.
    narrow = dict(objective.parameters) | {"tilt_drift": replace(usual, scale=1e-6)}
    objective = replace(objective, parameters=narrow)
    found = examine(baseline, objective, (), TILT, NO_STOPS, None, FINER)
    (refit,) = found.round_.refits
    assert found.round_.scores[0].p < NAMING_LEVEL and refit.log_evidence < WORTH
    assert refit.log_evidence == pytest.approx(found.round_.scores[0].log_evidence, abs=0.3)
    assert found.winner is None and found.round_.named == ()


def test_the_one_to_add_is_the_best_by_the_second_mesh_at_the_ends() -> None:
    objective, baseline = tilting()

    def at_ends(refits: list[Refit], at: Evaluation, finer: FineModels, _: Executor) -> list[Refit]:
        assert at is baseline.best and finer is FINER
        return [replace(refit, log_evidence=99.0) for refit in refits]

    with patch.object(selection_round, "with_second_mesh_at_ends", at_ends):
        found = examine(baseline, objective, (), EVERY, NO_STOPS, None, FINER)
    assert found.winner is not None and found.winner.log_evidence == 99.0
    assert found.round_.refits[0] is found.winner


def test_what_only_a_look_shows_is_held_against_the_second_mesh(lines: list[str]) -> None:
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))

    def looked(scores: list[Score], *_: Any) -> FiniteStepScores:
        seen = [replace(s, p=0.1 * NAMING_LEVEL) if s.cause.name == "tilt_drift" else s
                for s in scores]  # fmt: skip
        return FiniteStepScores(seen, [])

    meshes = FineModels(FINER.one, lambda: FINER.one)
    with patch.object(selection_round, "finite_step_scores", looked):
        found = examine(baseline, objective, (), TILT, NO_STOPS, None, meshes)
    assert lines.count("the same on a second mesh") == 1
    assert found.objective.second is not None and found.round_.lost is not None


def test_a_flip_has_to_promise_half_of_what_refits_under_the_correction_of_the_baseline_gain() -> (
    None
):
    """What has a correction of its own is no measure."""
    objective, baseline = tilting()
    found = examine(baseline, objective, (), TILT, NO_STOPS, None, FINER)
    (refit,) = found.round_.refits
    off = baseline.best
    lower = replace(refit.fit.best, residual=0.5 * refit.fit.best.residual)
    own = replace(refit, fit=replace(refit.fit, best=lower), corrected="at its end")
    asked: list[float] = []

    def tried(*given: Any) -> FlipTrial:
        asked.append(given[-1])
        return FlipTrial()

    with (
        patch.object(selection_round, "try_flips", tried),
        patch.object(selection_round, "LARGE", 0.0),
    ):
        for refits in ([refit], [own, refit]):
            selection_round._flips(
                refits, found.round_.goodness_of_fit, off, objective, (), None, Executor(1, 1)
            )
    assert asked[0] == asked[1] == pytest.approx(0.5 * (off.cost + refit.fit.best.cost))


ALONG = {"a": (1.0, 0.0, 0.0), "b": (0.0, 1.0, 0.0), "like b": (0.0, 0.999, 0.04), "c": (0, 0, 1.0)}


def named_of(refitted: Mapping[str, tuple[float, float]]) -> tuple[str, ...]:
    """The set, of causes along `ALONG` with a log evidence and a misfit where they are refitted."""

    def cause(name: str) -> Any:
        return SimpleNamespace(name=name)

    scores = [
        SimpleNamespace(cause=cause(n), directions=np.array([d]), strengths=np.ones(1))
        for n, d in ALONG.items()
    ]
    refits = [
        SimpleNamespace(cause=cause(name), log_evidence=evidence, own_misfit=misfit)
        for name, (evidence, misfit) in refitted.items()
    ]
    return set_of(cast(list[Refit], refits), cast(list[Score], scores))


def test_a_set_holds_what_evidence_does_not_part_and_what_does_the_same_as_one_of_these() -> None:
    apart = WITHIN + 1
    # The prior alone speaks against what does the same as b, whatever misfit the winner has.
    for winners in (40.0, 50.0, 70.0):
        parted = {"a": (20.0, winners), "b": (18.0, 52.0), "like b": (20.0 - apart, 52.0)}
        assert named_of(parted) == ("a", "b", "like b")
        # Here the data do.
        assert named_of(parted | {"like b": (20.0 - apart, 52.0 + 2 * WITHIN)}) == ("a", "b")
    # What resembles a cause that evidence has parted does not belong.
    alone = {"a": (20.0, 50.0), "b": (20.0 - apart, 62.0), "like b": (20.0 - apart, 62.0)}
    assert named_of(alone) == ("a",)
    # Of what was not refitted the likeness is all that is known.
    assert named_of({"a": (20.0, 50.0), "b": (18.0, 54.0)}) == ("a", "b", "like b")
    assert named_of({"a": (20.0, 50.0)}) == ("a",)

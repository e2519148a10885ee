from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from unittest.mock import patch

import pytest

from driver.diagnosis.answer.result_types import Diagnosis, DiscretisationCheck, Refit, Settings
from driver.diagnosis.causes.causes import LIBRARY, Cause
from driver.diagnosis.search import forward_selection
from driver.diagnosis.search.baseline import Prepared
from driver.diagnosis.search.boundary_noise import BoundaryNoiseSensitivities
from driver.diagnosis.search.extension import Extension, extended
from driver.diagnosis.search.fine_models import FineModels
from driver.diagnosis.search.forward_selection import Selection, with_correction_anew
from driver.diagnosis.search.refit import Executor, refit_causes
from driver.diagnosis.search.selection_round import ExaminedRound, at_first_sight, examine
from driver.diagnosis.statistics.screening import screened
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from solver_adapters.interface import NotRunError, SolverError
from tools import closed_form
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, finer, identified

BENCH = closed_form.problem()
BY_NAME = {cause.name: cause for cause in LIBRARY}
NO_STOPS = BoundaryNoiseSensitivities(None, None)
Examined = Callable[..., ExaminedRound]
TRUE, WRONG, OTHER = "tilt_drift", "magnification_drift", "end_rotation"


def misled(
    refitted: Sequence[str], named: tuple[str, ...], lost: DiscretisationCheck | None
) -> Callable[..., ExaminedRound]:
    """A round that prefers the first of these causes, after which nothing can be added."""

    def examined(
        here: Fit, objective: Objective, added: Sequence[Cause], settings: Settings,
        stops: BoundaryNoiseSensitivities, augmented: Evaluation | None, finer: FineModels,
    ) -> ExaminedRound:  # fmt: skip
        if added:
            seen = at_first_sight(here, objective, settings, stops)
            return ExaminedRound(replace(seen, lost=lost), None, here, objective)
        found = examine(here, objective, added, settings, stops, augmented, finer)
        _, names = screened(objective.model, here.best.free, settings.wanted)
        screening = objective.evaluate(here.values, names)
        by_name = {score.cause.name: score for score in found.round_.scores}
        chosen = [by_name[name] for name in refitted]
        refits = refit_causes(chosen, screening, here.best, objective, Executor(1, 1))
        # As near to the best as causes are that evidence does not part.
        refits = [replace(refit, log_evidence=20.0 - k) for k, refit in enumerate(refits)]
        return replace(
            found, round_=replace(found.round_, refits=tuple(refits), named=named), winner=refits[0]
        )

    return examined


def diagnosed(
    refitted: Sequence[str], named: tuple[str, ...], lost: DiscretisationCheck | None = None
) -> Diagnosis:
    made = closed_form.objective(BENCH, BENCH.truth | {TRUE: 4e-4})
    with patch.object(forward_selection, "examine", misled(refitted, named, lost)):
        return diagnosis_of(BENCH, identified(BENCH, made), replace(SETTINGS, refit=5))


def test_of_causes_that_evidence_does_not_part_the_one_that_leaves_nothing_is_named() -> None:
    found = diagnosed((WRONG, OTHER, TRUE), (WRONG, OTHER, TRUE))
    assert found.verdict.kind == "named" and found.verdict.names == (TRUE,)
    first, last = found.rounds
    assert first.named == (TRUE,) and first.left_something == (WRONG, OTHER)
    assert last.goodness_of_fit.accepted and TRUE in found.extended.best.free
    assert WRONG not in found.extended.best.free


def test_a_cause_that_was_told_from_the_best_is_not_taken_into_the_set_of_another() -> None:
    found = diagnosed((WRONG, OTHER, TRUE), (WRONG, TRUE))
    assert found.verdict.kind == "named" and found.verdict.names == (TRUE,)
    assert found.rounds[0].named == (TRUE,) and found.rounds[0].left_something == (WRONG,)


def test_a_cause_of_too_little_evidence_to_be_tried_is_not_told_to_leave_something() -> None:
    with patch.object(forward_selection, "WORTH", 18.5):  # the third has 18
        found = diagnosed((WRONG, TRUE, OTHER), (WRONG, TRUE, OTHER))
    assert found.rounds[0].named == (TRUE,) and found.rounds[0].left_something == (WRONG,)


def test_where_each_of_a_set_leaves_something_the_one_of_most_evidence_stays() -> None:
    found = diagnosed((WRONG, OTHER), (WRONG, OTHER))
    assert found.verdict.kind == "unexplained"
    first, last = found.rounds
    assert first.named == (WRONG, OTHER) and not first.left_something
    assert not last.goodness_of_fit.accepted and WRONG in found.extended.best.free


def test_what_a_second_mesh_takes_away_asks_for_no_other_cause() -> None:
    gone = DiscretisationCheck(2.0, BY_NAME[OTHER], "mesh", between_meshes=True)
    found = diagnosed((WRONG, TRUE), (WRONG, TRUE), gone)
    assert found.rounds[0].named == (WRONG, TRUE) and not found.rounds[0].left_something


def test_where_as_many_causes_were_added_as_there_may_be_no_rival_is_tried() -> None:
    with patch.object(forward_selection, "MOST_ADDITIONS", 1):
        found = diagnosed((WRONG, TRUE), (WRONG, TRUE))
    assert found.rounds[0].named == (WRONG, TRUE) and not found.rounds[0].left_something


def without_the_rival(error: SolverError) -> Diagnosis:
    def failing(before: Extension, winner: Refit, settings: Settings) -> Extension:
        if winner.cause.name == OTHER:
            raise error
        return extended(before, winner, settings)

    with patch.object(forward_selection, "extended", failing):
        return diagnosed((WRONG, OTHER), (WRONG, OTHER))


def test_a_rival_that_was_not_run_is_not_done_without() -> None:
    with pytest.raises(NotRunError):
        without_the_rival(NotRunError("absent"))


def test_a_rival_that_cannot_be_simulated_takes_nothing_away() -> None:
    found = without_the_rival(SolverError("no step is short enough"))
    assert found.rounds[0].named == (WRONG, OTHER)


def unless(*failing: str) -> Callable[[Extension, Refit, Settings], Extension]:
    """`extended` where the finer meshes cannot simulate some causes."""

    def tried(before: Extension, winner: Refit, settings: Settings) -> Extension:
        if winner.cause.name in failing:
            raise SolverError("a cell is inside out\nmore of it")
        return extended(before, winner, settings)

    return tried


def test_a_cause_whose_model_cannot_be_simulated_finer_gives_way_to_the_next() -> None:
    with patch.object(forward_selection, "extended", unless(WRONG)):
        found = diagnosed((WRONG, TRUE), (WRONG, TRUE))
    assert found.verdict.kind == "named" and found.verdict.names == (TRUE,)
    assert found.rounds[0].named == (TRUE,)
    why = "its model cannot be simulated (a cell is inside out)"
    told = f"{BY_NAME[WRONG].title} is not added, for {why}"
    assert told in found.verdict.text and not found.verdict.next.startswith("Let the fit")


def test_where_none_of_the_causes_can_be_simulated_finer_none_is_named_and_that_is_told() -> None:
    with patch.object(forward_selection, "extended", unless(WRONG, TRUE)):
        found = diagnosed((WRONG, TRUE), (WRONG, TRUE))
    assert found.verdict.kind == "unexplained" and not found.verdict.names
    assert found.extended is found.baseline and found.rounds[-1].named == ()
    assert all(
        f"{BY_NAME[name].title} is not added" in found.verdict.text for name in (WRONG, TRUE)
    )


def test_rounds_that_come_to_no_end_are_told() -> None:
    with patch.object(forward_selection, "MOST_ROUNDS", 1):
        found = diagnosed((TRUE,), (TRUE,))
    assert found.verdict.kind == "unexplained" and not found.causes
    assert (
        f"{BY_NAME[TRUE].title} is not added, for the rounds come to no end" in found.verdict.text
    )


def test_a_cause_that_is_added_after_all_is_not_told_to_be_missing() -> None:
    """Two effects; the model of the stronger one cannot be simulated at first, or never."""
    made = closed_form.objective(BENCH, BENCH.truth | {TRUE: 2e-3, "load_drift": 50.0})
    settings = replace(SETTINGS, wanted=(TRUE, "load_drift"))
    baseline = identified(BENCH, made)
    tries: list[str] = []

    def at_first(before: Extension, winner: Refit, settings: Settings) -> Extension:
        tries.append(winner.cause.name)
        if len(tries) == 1:
            raise SolverError("no step is short enough")
        return extended(before, winner, settings)

    with patch.object(forward_selection, "extended", at_first):
        found = diagnosis_of(BENCH, baseline, settings)
    assert set(found.verdict.names) == {TRUE, "load_drift"} and tries[0] == tries[2]
    assert "is not added" not in found.verdict.text
    with patch.object(forward_selection, "extended", unless(tries[0])):
        found = diagnosis_of(BENCH, baseline, settings)
    assert found.verdict.text.count(f"{BY_NAME[tries[0]].title} is not added") == 1


def selected(hidden: dict[str, float], settings: Settings, examined: Examined) -> Selection:
    """The rounds of a diagnosis, each of them as told."""
    objective, baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth | hidden))
    begin = Prepared(baseline, objective, None, (), None, ())
    with patch.object(forward_selection, "examine", examined):
        return forward_selection.forward_selection(
            begin, FineModels(finer(BENCH)), NO_STOPS, settings
        )


def test_what_could_not_be_added_is_tried_again_where_the_model_is_corrected_anew() -> None:
    settings = replace(SETTINGS, wanted=(TRUE, "load_drift"))
    with patch.object(forward_selection, "extended", unless("load_drift")):
        found = selected({TRUE: 2e-3, "load_drift": 50.0}, settings, examine)
    assert len(found.doubts) == 1 and [cause.name for cause in found.end.causes] == [TRUE]
    again = with_correction_anew(found, NO_STOPS, settings)
    assert {cause.name for cause in again.end.causes} == {TRUE, "load_drift"}
    assert again.doubts == () and again.begin is found.begin
    assert again.rounds[0] is found.rounds[0] and len(again.rounds) == 3


def test_rivals_that_left_something_are_not_tried_again(lines: list[str]) -> None:
    examined = misled((WRONG, OTHER), (WRONG, OTHER), None)
    hidden = {TRUE: 4e-4, "magnification_drift": 2e-3}
    found = selected(hidden, replace(SETTINGS, refit=5), examined)
    tried = f"{WRONG} leaves something: {OTHER} is tried in its place"
    assert lines.count(tried) == 1
    with patch.object(forward_selection, "examine", examined):
        again = with_correction_anew(found, NO_STOPS, SETTINGS)
    assert not again.rounds[-1].goodness_of_fit.accepted and lines.count(tried) == 1

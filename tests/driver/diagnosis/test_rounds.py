from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from unittest.mock import patch

from driver.diagnosis import rounds
from driver.diagnosis.boundary_noise import Stops
from driver.diagnosis.causes import Cause
from driver.diagnosis.outcome import Diagnosis, Log, Settings, Step
from driver.diagnosis.refit import Crew, Refit, refit_causes
from driver.diagnosis.round import at_first_sight, examine
from driver.diagnosis.screening import screened
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.model import ForwardModel
from tests.driver import closed_form
from tests.driver.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

BENCH = closed_form.bench()
TRUE, WRONG, OTHER = "tilt_drift", "magnification_drift", "end_rotation"


def misled(members: tuple[str, ...]) -> Callable[..., tuple[Step, Refit | None]]:
    """A round that prefers the first of these causes, after which nothing can be added."""

    def examined(
        here: Fit, objective: Objective, added: Sequence[Cause], settings: Settings, stops: Stops,
        wide: Evaluation | None, another: Callable[[], ForwardModel] | None, log: Log,
    ) -> tuple[Step, Refit | None]:  # fmt: skip
        if added:
            return at_first_sight(here, objective, settings, stops, log), None
        step, _ = examine(here, objective, added, settings, stops, wide, another, log)
        _, names = screened(objective.model, here.best.free, settings.wanted)
        screening = objective.evaluate(here.values, names)
        by_name = {score.cause.name: score for score in step.scores}
        chosen = [by_name[name] for name in members]
        refits = refit_causes(chosen, screening, here.best, objective, Crew(1, 1, log))
        return replace(step, refits=tuple(refits), named=members), refits[0]

    return examined


def diagnosed(*members: str) -> Diagnosis:
    made = closed_form.objective(BENCH, BENCH.truth | {TRUE: 4e-4})
    with patch.object(rounds, "examine", misled(members)):
        return diagnosis_of(BENCH, identified(BENCH, made), replace(SETTINGS, refit=5))


def test_of_causes_that_evidence_does_not_part_the_one_that_leaves_nothing_is_named() -> None:
    found = diagnosed(WRONG, OTHER, TRUE)
    assert found.verdict.kind == "named" and found.verdict.causes == (TRUE,)
    first, last = found.steps
    assert first.named == (TRUE,) and first.left_something == (WRONG, OTHER)
    assert last.omnibus.accepted and TRUE in found.extended.best.free
    assert WRONG not in found.extended.best.free


def test_where_each_of_a_set_leaves_something_the_one_of_most_evidence_stays() -> None:
    found = diagnosed(WRONG, OTHER)
    assert found.verdict.kind == "unexplained"
    first, last = found.steps
    assert first.named == (WRONG, OTHER) and not first.left_something
    assert not last.omnibus.accepted and WRONG in found.extended.best.free

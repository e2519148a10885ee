"""A band across a grain is found where it lies, and none where there is none."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from driver.common.outcomes import Failure
from driver.common.progress import collected_lines
from driver.diagnosis.answer.result_types import Refit
from driver.diagnosis.search import (
    candidate_correction,
    corrected_looks,
    finite_step_score,
    looks,
    looks_in_places,
)
from driver.diagnosis.search.refit import with_prior
from driver.diagnosis.statistics.score_test import NAMING_LEVEL, Score
from driver.identification.correction import Correction, correction
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation, SolverError
from solver_adapters.material import with_parameters
from tests.driver.diagnosis.search.examined import (
    Examined,
    finer_of,
    look,
    score_of,
    scored,
    with_scores,
)
from tools.closed_form import ClosedFormSolver

BESIDE_BAND = ("band_grain2", "cold_work", "residual_stress")
BAND = {
    "tau0_grain2_band": -0.3,
    "tau0_grain2_band_middle": 0.6,
    "tau0_grain2_band_half_width": 0.4,
}
SHAPED = {"tau0_112": (-0.5, 0.4), "tau0_grain2": (0.2, 0.8), "C44_scale": (0.8, 1.6)}
"""What a band does here: other things in other places along the grain, and how much of each."""


def as_shaped(height: float, middle: float, half_width: float) -> dict[str, float]:
    return {
        name: float(np.exp(much * height * np.exp(-(((place - middle) / half_width) ** 2))))
        for name, (place, much) in SHAPED.items()
    }


class Banded(ClosedFormSolver):
    """A solver that knows a band across the second grain."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        band = (m.tau0_grain2_band, m.tau0_grain2_band_middle, m.tau0_grain2_band_half_width)
        return super().answer(replace(simulation, material=with_parameters(m, as_shaped(*band))))


class Coarse(Banded):
    """The same whose cells make half of a band, until they are finer."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        if not self.finer:
            m = replace(m, tau0_grain2_band=0.5 * m.tau0_grain2_band)
        return super().answer(replace(simulation, material=m))


class Strengthened(Banded):
    """A solver in which a softer band is another thing than a harder one with its sign changed."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        m = simulation.material
        if m.tau0_grain2_band < 0.0:
            softer = replace(
                m, tau0_112=m.tau0_112 * np.exp(m.tau0_grain2_band), tau0_grain2_band=0
            )
            simulation = replace(simulation, material=softer)
        return super().answer(simulation)


def with_band(height: float, seed: int = 0, solver: type[Banded] = Banded) -> Examined:
    """The scores at a fit without a band, to data that have one."""
    _, middle, half_width = BAND.values()
    return scored(as_shaped(height, middle, half_width), BESIDE_BAND, solver, seed)


@pytest.mark.parametrize("height", [-0.3, 0.3])
def test_a_band_is_found_where_it_lies_with_its_height_and_its_width(height: float) -> None:
    """Its derivative is that of a band in the middle of the grain, and shows less."""
    hidden = with_band(height)
    near = score_of(hidden.scores, "band_grain2")
    found = look(hidden, accepted=False)
    band = found.scores[0]
    assert band.cause.name == "band_grain2" and band.p < NAMING_LEVEL
    assert band.statistic > 2 * near.statistic
    (refit,) = found.refits
    for name, value in (BAND | {"tau0_grain2_band": height}).items():
        sigma = refit.fit.sigma(name, hidden.objective.parameters)
        assert abs(refit.fit.values[name] - value) < 3 * sigma, name


def test_a_harder_band_is_found_where_softer_ones_show_nothing_of_it() -> None:
    hidden = with_band(0.3, solver=Strengthened)
    near = score_of(hidden.scores, "band_grain2")
    task = looks.Task(near, hidden.fit, hidden.objective, finer_of(hidden), 10, 1.0, 1.0)
    sides = looks_in_places.looks_in_places(task, with_prior(hidden.objective, near.cause))
    assert {s.amount > 0 for s in sides if looks.on_its_side(s) and looks.promises(s)} == {True}
    (refit,) = look(hidden, accepted=False).refits
    for name, value in (BAND | {"tau0_grain2_band": 0.3}).items():
        sigma = refit.fit.sigma(name, hidden.objective.parameters)
        assert abs(refit.fit.values[name] - value) < 3 * sigma, name


def test_a_band_of_which_the_cells_make_half_is_found_under_the_correction_where_it_lies() -> None:
    """That of the fit knows no band: it would be twice as high."""
    hidden = with_band(-0.3, solver=Coarse)
    found = look(hidden, accepted=False)
    (refit,) = found.refits
    assert abs(refit.fit.values["tau0_grain2_band"] + 0.3) < 0.1


def test_a_place_that_promises_is_seen_under_the_correction_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Half of the effect is the correction: without it a band would have to be twice as high."""
    hidden = with_band(-0.3, solver=Coarse)
    near = score_of(hidden.scores, "band_grain2")
    task = looks.Task(near, hidden.fit, hidden.objective, finer_of(hidden), 10, 1.0, 1.0)

    def best() -> Score:
        sides = looks_in_places.looks_in_places(task, with_prior(hidden.objective, near.cause))
        scores = [side.score for side in sides if looks.on_its_side(side)]
        return max(scores, key=lambda s: s.statistic)

    corrected = best()
    monkeypatch.setattr(looks, "PROMISING", 0.0)
    assert best().estimate == pytest.approx(2.0 * corrected.estimate, rel=0.2)


def test_the_two_places_that_promise_most_are_seen_under_the_correction_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    hidden, made = with_band(-0.6), correction
    near = score_of(hidden.scores, "band_grain2")
    task = looks.Task(near, hidden.fit, hidden.objective, finer_of(hidden), 10, 1.0, 1.0)
    seen: list[float] = []

    def corrected(model: Any, finer: Any, at: Any, values: Any, **rest: Any) -> Correction:
        seen.append(values["tau0_grain2_band_middle"])
        return made(model, finer, at, values, **rest)

    monkeypatch.setattr(corrected_looks, "correction", corrected)
    sides = looks_in_places.looks_in_places(task, with_prior(hidden.objective, near.cause))
    sides = [side for side in sides if looks.on_its_side(side)]
    assert sum(looks.promises(side) for side in sides) > 2
    best = sorted(sides, key=lambda side: -side.score.statistic)[:2]
    assert set(seen) == {side.at.values["tau0_grain2_band_middle"] for side in best}


def test_a_refit_begins_where_a_place_was_seen_under_its_own_correction(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What a place shows without it may be no more than what the cells make of a band."""
    hidden, seen = with_band(-0.3), looks_in_places.looks_in_places
    begun: list[looks.Side] = []

    def with_one_more(*task: Any) -> list[looks.Side]:
        sides = seen(*task)
        best = max(sides, key=lambda side: (side.is_corrected, side.score.statistic))
        more = replace(best.score, statistic=2 * best.score.statistic)
        return [*sides, replace(best, score=more, correction=None)]

    def begin(task: looks.Task, extended: Any, side: looks.Side) -> None:
        begun.append(side)

    monkeypatch.setattr(finite_step_score, "looks_in_places", with_one_more)
    monkeypatch.setattr(finite_step_score, "refit_from_look", begin)
    look(hidden, accepted=False)
    assert [side.is_corrected for side in begun] == [True]


@pytest.mark.parametrize(("times", "refits"), [(3.0, 1), (5.0, 0)])
def test_a_band_is_refitted_where_a_place_promises_a_quarter_of_the_best(
    times: float, refits: int
) -> None:
    """Place and width are free in its refit, and a look knows neither."""
    hidden = with_band(-0.3)
    near = score_of(hidden.scores, "band_grain2")
    task = looks.Task(near, hidden.fit, hidden.objective, finer_of(hidden), 10, 1.0, 1.0)
    sides = looks_in_places.looks_in_places(task, with_prior(hidden.objective, near.cause))
    shown = max(side.score.log_evidence for side in sides if side.is_corrected)
    rival = replace(score_of(hidden.scores, "cold_work"), log_evidence=times * shown)
    assert len(look(with_scores(hidden, rival), accepted=False).refits) == refits


@pytest.mark.parametrize("failing", [1, 2])
def test_a_correction_that_fails_leaves_what_was_seen_and_fitted_before(
    monkeypatch: pytest.MonkeyPatch, failing: int
) -> None:
    hidden, corrected = with_band(-0.3), candidate_correction.corrected_refit
    calls: list[Refit] = []

    def fails(refit: Refit, *rest: Any) -> Refit | Failure:
        calls.append(refit)
        if len(calls) == failing:
            return Failure("no solution")
        return corrected(refit, *rest)

    monkeypatch.setattr(corrected_looks, "corrected_refit", fails)
    with collected_lines() as lines:
        found = look(hidden, accepted=False)
    assert any("no further correction, for that failed (no solution)" in line for line in lines)
    assert [refit.corrected for refit in found.refits] == ["at a look"] * (failing - 1)
    if failing == 1:
        # A place alone has neither the evidence nor the size of its refit.
        assert score_of(found.scores, "band_grain2").p >= NAMING_LEVEL


def test_a_place_that_cannot_be_simulated_finer_counts_as_the_working_mesh_shows_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fails(*_: Any, **__: Any) -> Correction:
        raise SolverError("no solution")

    hidden = with_band(-0.3)
    monkeypatch.setattr(corrected_looks, "correction", fails)
    with collected_lines() as lines:
        (refit,) = look(hidden, accepted=False).refits
    assert sum("cannot be simulated finer (no solution)" in line for line in lines) > 0
    assert abs(refit.fit.values["tau0_grain2_band_middle"] - 0.6) < 0.3


def test_a_band_that_the_case_states_is_looked_at_where_it_is_stated() -> None:
    hidden = with_band(-0.3)
    stated = with_parameters(hidden.objective.model.material, BAND | {"tau0_grain2_band": -0.1})
    objective = replace(hidden.objective, model=replace(hidden.objective.model, material=stated))
    near = score_of(hidden.scores, "band_grain2")
    fitted = replace(hidden.fit, best=replace(hidden.fit.best, values=hidden.fit.values | BAND))
    task = looks.Task(near, fitted, objective, finer_of(hidden), 10, 1.0, 1.0)
    sides = looks_in_places.looks_in_places(task, with_prior(objective, near.cause))
    seen = [side.at.values for side in sides]
    assert [v["tau0_grain2_band_middle"] for v in seen] == [BAND["tau0_grain2_band_middle"]] * 2
    assert [v["tau0_grain2_band"] for v in seen] == pytest.approx([-0.4, 0.2])
    assert [side.amount for side in sides] == pytest.approx([-3.0, 3.0])


def test_a_band_has_nine_tries_of_its_own_in_the_family() -> None:
    hidden = with_band(-0.3)
    alone = len(hidden.scores)
    assert score_of(look(hidden, accepted=False).scores, "band_grain2").family == alone + 9


def test_a_band_is_looked_at_though_its_derivative_makes_it_lead() -> None:
    hidden = with_band(-0.3)
    leads = replace(score_of(hidden.scores, "band_grain2"), p=1e-9, log_evidence=20.0)
    (refit,) = look(with_scores(hidden, leads), accepted=False).refits
    middle = "tau0_grain2_band_middle"
    assert abs(refit.fit.values[middle] - BAND[middle]) < 0.1


def test_no_band_is_looked_at_where_nothing_is_wrong() -> None:
    right = with_band(0.0)
    assert look(right, accepted=True).scores == right.scores


@pytest.mark.parametrize("seed", range(4))
def test_no_band_is_seen_where_there_is_none_though_its_place_is_free(seed: int) -> None:
    found = look(with_band(0.0, seed), accepted=False)
    assert all(s.p >= NAMING_LEVEL for s in found.scores)


def test_a_band_is_visible_from_the_height_that_shows_in_every_place() -> None:
    """Its derivative is that of one place more."""
    right = with_band(0.0)
    near = score_of(right.scores, "band_grain2")

    def visible(places: tuple[float, ...]) -> float:
        placed = replace(near, cause=replace(near.cause, places=places))
        (found,) = score_of(
            look(with_scores(right, placed), accepted=False).scores, placed.cause.name
        ).visible
        return float(found)

    assert visible((0.25,)) == near.visible < visible((-1.2,)) == visible((0.25, -1.2))

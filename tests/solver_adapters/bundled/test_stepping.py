"""Time stepping with a crystal law that fails or misleads where the test says so."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import pytest

from solver_adapters.bundled.instants import Increment, Instant
from solver_adapters.bundled.points import Points, PointSolution
from solver_adapters.bundled.problem import Problem, build_problem, build_tangents
from solver_adapters.bundled.stepping import Stepper
from solver_adapters.interface import FloatArray, SolverError
from solver_adapters.material import Material
from tests.solver_adapters.boxes import box, pulled

ELASTIC, PLASTIC = 1e-4, 8e-3
PARTS = 2.0**-10
"""The smallest part of a step that is tried."""


@dataclass(frozen=True, eq=False)
class Law(Points):
    """The crystal law, except that a point fails in long steps and that the tangent is wrong.

    Attributes:
        longest: no point fails in a step up to this length [s].
        failing: the point that fails in longer ones.
        tangent: factor on the tangent.
        calls: lengths of the steps it was asked for [s].
    """

    longest: float = np.inf
    failing: int = 0
    tangent: float = 1.0
    calls: list[float] = field(default_factory=list)

    def update(
        self, H: FloatArray, state0: FloatArray, guess: FloatArray, dt: float, *more: Any
    ) -> PointSolution:
        self.calls.append(dt)
        solution = super().update(H, state0, guess, dt, *more)
        if dt > self.longest:
            solution.iterations[self.failing] = -1
        return replace(solution, C=self.tangent * solution.C)


@dataclass(frozen=True, eq=False)
class Pulled:
    """A box pulled at constant speed to a strain at 1 s, and its stepper."""

    problem: Problem
    stepper: Stepper
    speed: FloatArray

    def motion(self, time: float) -> FloatArray:
        return time * self.speed

    def advance(self, *ends: float, instant: Instant | None = None) -> Instant:
        start = self.stepper.start(0.0) if instant is None else instant
        return self.stepper.advance(start, np.array(ends), self.motion, _no_tangent)

    def start_from_rest(self) -> None:
        """Have the next step begin with the ends moved and all else at rest."""
        still = np.zeros((self.problem.n_nodes, 3))
        slips = np.zeros((self.problem.points.grain.size, 24))
        last = Increment(still, slips, self.speed, 1.0)
        self.stepper.resume({True: last}, [], (0, 0, 0, 0))


def _no_tangent(time: float) -> FloatArray:
    raise AssertionError("nobody asked for derivatives")


def _pulled(
    strain: float, tolerance: float = 1e-9, accuracy: float | None = None, **law: Any
) -> Pulled:
    simulation = pulled(box(), Material(strain_measure="small"), (strain,))
    problem = build_problem(simulation)
    parts = {item.name: getattr(problem.points, item.name) for item in fields(Points)}
    problem = replace(problem, points=Law(**parts, **law))
    stepper = Stepper(problem, build_tangents(simulation, problem), tolerance, accuracy)
    return Pulled(problem, stepper, problem.motion[1])


def _calls(case: Pulled) -> list[float]:
    law = case.problem.points
    assert isinstance(law, Law)
    return law.calls


def test_a_step_is_halved_until_it_converges_and_doubled_after_each_success() -> None:
    """No step above 0.3 s converges: 1 and ½ are cut, ¼ taken, ½ tried again and cut, …"""
    case = _pulled(ELASTIC, longest=0.3)
    instant = case.advance(1.0)
    statistics = case.stepper.statistics
    assert statistics.ends == [0.25, 0.5, 0.75, 1.0]
    assert (statistics.steps, statistics.cuts, statistics.refinements) == (4, 2 + 2, 0)
    assert instant.time == 1.0


def test_the_next_asked_step_begins_with_its_whole_length() -> None:
    case = _pulled(ELASTIC, longest=0.3)
    case.advance(1.0, 1.25, 1.5)
    assert case.stepper.statistics.ends[4:] == [1.25, 1.5]


def test_an_elastic_answer_does_not_depend_on_the_cuts() -> None:
    whole = _pulled(ELASTIC).advance(1.0)
    parts = _pulled(ELASTIC, longest=0.1).advance(1.0)
    np.testing.assert_allclose(parts.force, whole.force, rtol=1e-7)
    np.testing.assert_allclose(parts.u, whole.u, atol=1e-7 * abs(whole.u).max())


def test_a_step_that_cannot_be_saved_names_time_length_element_and_grain() -> None:
    """Ten halvings are tried. The box has four points a cell, and grain 2 in its upper half."""
    probe = _pulled(ELASTIC)
    failing = int(np.flatnonzero(probe.problem.points.grain == 1)[5])
    case = _pulled(ELASTIC, longest=0.5 * PARTS, failing=failing)
    message = (
        f"no solution at t = {PARTS:.6g} s with steps cut to {PARTS:.3g} s: the crystal law did "
        f"not converge (element {failing // 4}, grain 2)"
    )
    with pytest.raises(SolverError, match=f"^{re.escape(message)}$"):
        case.advance(1.0)
    assert case.stepper.statistics.cuts == 10
    assert case.stepper.statistics.steps == 0


def test_where_equilibrium_stalls_the_message_says_how_far_off_and_the_grain_of_the_element() -> (
    None
):
    """A tangent of the wrong sign leads away from equilibrium however short the step."""
    case = _pulled(0.1 * ELASTIC, tangent=-1.0)
    case.start_from_rest()
    with pytest.raises(SolverError, match="the equilibrium iteration stalled at a") as failure:
        case.advance(1.0)
    found = re.search(r"residual of (\S+) µN \(element (\d+), grain (\d+)\)$", str(failure.value))
    assert found is not None
    assert float(found[1]) > 0.0
    grain = case.problem.points.grain[4 * int(found[2])]
    assert int(found[3]) == grain + 1


def test_the_line_search_halves_a_step_that_a_soft_tangent_makes_too_long() -> None:
    """With a third of the true tangent a full step turns the residual r into −2 r, half of it
    into −r/2: one evaluation in vain and one of use in each iteration, and half the residual.
    """
    case = _pulled(0.1 * ELASTIC, tolerance=1e-3, tangent=1 / 3)
    case.start_from_rest()
    instant = case.advance(1.0)
    statistics = case.stepper.statistics
    assert statistics.cuts == 0
    assert statistics.iterations >= 5
    assert len(_calls(case)) == 1 + 2 * statistics.iterations
    exact = _pulled(0.1 * ELASTIC).advance(1.0)
    np.testing.assert_allclose(instant.force, exact.force, rtol=2e-3)


def test_an_elastic_step_like_the_last_needs_no_iteration() -> None:
    """The increment of the last step of its kind, scaled by the motion, is the solution."""
    case = _pulled(ELASTIC)
    instant = case.advance(0.4)
    before, calls = case.stepper.statistics.iterations, len(_calls(case))
    case.advance(1.0, instant=instant)
    assert case.stepper.statistics.iterations == before
    assert len(_calls(case)) == calls + 1


def test_a_stepper_that_resumes_goes_on_as_the_one_before() -> None:
    """With the same iterations, since their start is part of what is handed over."""
    ends = (0.2, 0.4, 0.6, 0.8, 1.0)
    whole = _pulled(PLASTIC)
    last = whole.advance(*ends)
    first = _pulled(PLASTIC)
    instant = first.advance(*ends[:3])
    s = first.stepper.statistics
    second = _pulled(PLASTIC)
    counts = (s.steps, s.iterations, s.cuts, s.refinements)
    second.stepper.resume(first.stepper.last, s.ends, counts)
    found = second.advance(*ends[3:], instant=instant)
    np.testing.assert_allclose(found.u, last.u, atol=1e-9 * abs(last.u).max())
    np.testing.assert_allclose(found.force, last.force, rtol=1e-9)
    for name in ("steps", "iterations", "cuts", "refinements", "ends"):
        expected = getattr(whole.stepper.statistics, name)
        assert getattr(second.stepper.statistics, name) == expected


def test_moves_and_holds_are_remembered_apart() -> None:
    case = _pulled(PLASTIC)
    instant = case.advance(0.5)
    hold: Callable[[float], FloatArray] = lambda time: 0.5 * case.speed  # noqa: E731
    held = case.stepper.advance(instant, np.array([0.9]), hold, _no_tangent)
    last = case.stepper.last
    assert set(last) == {True, False}
    np.testing.assert_array_equal(last[True].du, instant.u)
    np.testing.assert_array_equal(last[False].du, held.u - instant.u)
    assert last[True].dt == 0.5
    assert last[False].dt == pytest.approx(0.4)
    assert not last[False].motion.any()


def test_a_hold_relaxes_the_force() -> None:
    case = _pulled(PLASTIC)
    instant = case.advance(0.5, 1.0)
    held = case.stepper.advance(instant, np.array([2.0, 20.0]), lambda _: case.speed, _no_tangent)
    assert 0.5 * instant.force < held.force < instant.force


def test_steps_are_refined_where_the_error_of_the_force_is_asked_to_be_small() -> None:
    """First yield is refined, the elastic steps before are not, no step fails to converge."""
    ends = np.arange(1, 6) / 5
    coarse, fine = _pulled(PLASTIC), _pulled(PLASTIC, accuracy=0.5)
    coarse.advance(*ends)
    fine.advance(*ends)
    statistics = fine.stepper.statistics
    assert coarse.stepper.statistics.refinements == 0
    assert statistics.refinements > 0
    assert statistics.cuts == 0
    assert statistics.steps > 5
    assert set(ends) <= set(statistics.ends)

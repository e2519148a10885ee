"""Time stepping: cuts, regrowth and refinement, with a crystal law that fails on demand."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import Problem, build_tangents
from solver_adapters.bundled.fem.state import Instant
from solver_adapters.bundled.stepping import Stepper
from solver_adapters.interface import SolverError
from solver_adapters.material import Material
from tests.solver_adapters.bundled.troubled_law import troubled_problem
from tools.boxes import box, pulled

ELASTIC, PLASTIC = 1e-4, 8e-3
PARTS = 2.0**-10
"""The smallest part of a step that is tried."""


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
        return self.course(start, ends, self.motion)

    def course(
        self, start: Instant, ends: Sequence[float], motion: Callable[[float], FloatArray]
    ) -> Instant:
        law = self.stepper.tangents.law
        return self.stepper.advance(start, np.array(ends), motion, _no_tangent, law)


def _no_tangent(time: float) -> FloatArray:
    raise AssertionError("nobody asked for derivatives")


def _pulled(
    strain: float, tolerance: float = 1e-9, accuracy: float | None = None, **law: Any
) -> Pulled:
    simulation = pulled(box(), Material(strain_measure="small"), (strain,))
    problem = troubled_problem(simulation, **law)
    stepper = Stepper(problem, build_tangents(simulation, problem), tolerance, accuracy)
    return Pulled(problem, stepper, problem.motion[1])


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
    second.stepper.resume(first.stepper.last, s.ends, first.stepper.course, counts)
    found = second.advance(*ends[3:], instant=instant)
    np.testing.assert_allclose(found.u, last.u, atol=1e-9 * abs(last.u).max())
    np.testing.assert_allclose(found.force, last.force, rtol=1e-9)
    np.testing.assert_allclose(second.stepper.course, whole.stepper.course, rtol=1e-6, atol=1e-12)
    assert len(second.stepper.course) == 5
    for name in ("steps", "iterations", "cuts", "refinements", "ends"):
        expected = getattr(whole.stepper.statistics, name)
        assert getattr(second.stepper.statistics, name) == expected


def test_moves_and_holds_are_remembered_apart() -> None:
    case = _pulled(PLASTIC)
    instant = case.advance(0.5)

    def hold(time: float) -> FloatArray:
        return 0.5 * case.speed

    held = case.course(instant, [0.9], hold)
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
    held = case.course(instant, [2.0, 20.0], lambda _: case.speed)
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

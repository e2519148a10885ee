"""Newton's method for one step, with a crystal law that fails or misleads on demand."""

from __future__ import annotations

import re
import weakref
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled import equilibrium
from solver_adapters.bundled.equilibrium import Equilibrium, NotConvergedError, Trial
from solver_adapters.bundled.fem.problem import Problem
from solver_adapters.bundled.fem.state import Increment, Instant
from solver_adapters.bundled.linear.split_matrix import RESIDUAL
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.material import Material
from tests.solver_adapters.bundled.troubled_law import calls, troubled_problem
from tools.boxes import box, pulled

ELASTIC, PLASTIC = 1e-4, 4e-3


@dataclass(frozen=True, eq=False)
class Case:
    """A box at rest, to be pulled in steps of 1 s."""

    problem: Problem
    equilibrium: Equilibrium
    start: Instant

    def solve(
        self,
        share: float = 1.0,
        start: Instant | None = None,
        last: dict[bool, Increment] | None = None,
        near: FloatArray | None = None,
    ) -> Trial:
        """A step to a share of the motion."""
        motion = share * self.problem.motion[1]
        return self.equilibrium.solve_step(start or self.start, motion, 1.0, last or {}, near)

    @property
    def iterations(self) -> int:
        return self.equilibrium.statistics.iterations

    def from_rest(self) -> dict[bool, Increment]:
        """An increment that has a step begin with the ends moved and all else at rest."""
        still, slips = np.zeros_like(self.start.u), np.zeros((len(self.start.H), 24))
        return {True: Increment(still, slips, self.problem.motion[1], 1.0, still)}


def _case(strain: float, tolerance: float = 1e-9, **law: Any) -> Case:
    simulation = pulled(box(), Material(strain_measure="small"), (strain,))
    problem = troubled_problem(simulation, **law)
    n, nodes = problem.points.grain.size, problem.n_nodes
    none = np.zeros(0)
    start = Instant(
        0.0, np.zeros((nodes, 3)), np.zeros((n, 9)), problem.state, 0.0,
        np.zeros((nodes, 3, 0)), np.zeros((n, 0, 0)), none,
    )  # fmt: skip
    return Case(problem, Equilibrium(problem, tolerance, Statistics()), start)


def _end_of(case: Case, trial: Trial) -> Instant:
    start = case.start
    return Instant(1.0, trial.u, trial.H, trial.state, 0.0, start.du, start.dstate, start.dforce)


def test_a_solved_step_balances_its_free_forces_and_has_the_asked_motion() -> None:
    case = _case(PLASTIC, tolerance=1e-8)
    trial = case.solve()
    p = case.problem
    free, held = trial.forces[p.pattern.free], trial.forces[p.prescribed]
    assert np.linalg.norm(free) <= 1e-8 * np.linalg.norm(held)
    np.testing.assert_allclose(trial.u.ravel()[p.prescribed], p.motion[1], atol=1e-15)
    assert np.count_nonzero(trial.slips) > 0
    assert trial.local_failure is None


def test_an_elastic_step_from_nothing_needs_its_first_tangent_alone() -> None:
    """The law is asked at rest, for the tangent, and at the end."""
    case = _case(ELASTIC)
    case.solve()
    assert case.iterations == 0
    assert len(calls(case.problem)) == 2


def test_an_elastic_step_like_the_last_needs_no_iteration() -> None:
    """The increment of the last step of its kind, scaled by the motion, is the solution."""
    case = _case(ELASTIC)
    first = case.solve(0.4)
    before = len(calls(case.problem))
    held, none = 0.4 * case.problem.motion[1], np.zeros_like(first.u)
    increment = Increment(first.u, first.slips, held, 1.0, none)
    second = case.solve(1.0, _end_of(case, first), {True: increment})
    assert case.iterations == 0
    assert len(calls(case.problem)) == before + 1
    np.testing.assert_allclose(second.u, 2.5 * first.u, atol=1e-9 * abs(first.u).max())


def test_a_step_that_a_nearby_simulation_took_needs_no_iteration() -> None:
    solved = _case(PLASTIC).solve()
    case = _case(PLASTIC)
    again = case.solve(near=solved.u)
    assert case.iterations == 0
    assert len(calls(case.problem)) == 1
    np.testing.assert_allclose(again.slips, solved.slips, atol=1e-6 * abs(solved.slips).max())


def test_the_first_step_of_its_kind_is_a_nearby_one_scaled_by_the_motion() -> None:
    whole = _case(ELASTIC).solve().u
    case = _case(ELASTIC)
    found = case.solve(near=0.5 * whole)
    assert case.iterations == 0
    assert len(calls(case.problem)) == 1
    np.testing.assert_allclose(found.u, whole, atol=1e-9 * abs(whole).max())


def test_of_a_step_beside_a_nearby_one_the_difference_is_scaled() -> None:
    """A body that is pulled twice as far as the nearby one, in steps of 0.4 and 0.6."""
    whole = _case(ELASTIC).solve().u
    case = _case(ELASTIC)
    first = case.solve(0.4, near=0.2 * whole)
    before = len(calls(case.problem))
    held = 0.4 * case.problem.motion[1]
    increment = Increment(first.u, first.slips, held, 1.0, 0.2 * whole)
    second = case.solve(1.0, _end_of(case, first), {True: increment}, near=0.3 * whole)
    assert len(calls(case.problem)) == before + 1
    np.testing.assert_allclose(second.u, whole, atol=1e-9 * abs(whole).max())


def test_a_nearby_simulation_that_leads_nowhere_costs_time_and_no_cut() -> None:
    solved = _case(PLASTIC).solve()
    case = _case(PLASTIC)
    found = case.solve(near=1e3 * np.random.default_rng(2).standard_normal(solved.u.shape))
    np.testing.assert_allclose(found.u, solved.u, atol=1e-7 * abs(solved.u).max())


def test_a_step_is_a_move_where_its_boundary_moves_and_a_hold_elsewhere() -> None:
    case = _case(PLASTIC)
    moved = case.solve()
    held = case.solve(1.0, _end_of(case, moved))
    assert moved.moves
    assert not held.moves


def test_where_a_law_fails_the_message_names_the_element_and_its_grain() -> None:
    """The box has four points a cell, and grain 2 in its upper half."""
    probe = _case(ELASTIC)
    failing = int(np.flatnonzero(probe.problem.points.grain == 1)[5])
    case = _case(ELASTIC, longest=0.5, failing=failing)
    message = f"the crystal law did not converge (element {failing // 4}, grain 2)"
    with pytest.raises(NotConvergedError, match=f"^{re.escape(message)}$"):
        case.solve(last=case.from_rest())


def test_where_equilibrium_stalls_the_message_says_how_far_off_and_the_grain_of_the_element() -> (
    None
):
    """A tangent of the wrong sign leads away from equilibrium."""
    case = _case(0.1 * ELASTIC, tangent=-1.0)
    with pytest.raises(
        NotConvergedError, match="the equilibrium iteration stalled at a"
    ) as failure:
        case.solve(last=case.from_rest())
    found = re.search(r"residual of (\S+) µN \(element (\d+), grain (\d+)\)$", str(failure.value))
    assert found is not None
    assert float(found[1]) > 0.0
    grain = case.problem.points.grain[4 * int(found[2])]
    assert int(found[3]) == grain + 1


def test_the_line_search_halves_a_step_that_a_soft_tangent_makes_too_long() -> None:
    """With a third of the true tangent a full step turns the residual r into −2 r, half of it
    into −r/2: one evaluation in vain and one of use in each iteration, and half the residual.
    """
    case = _case(0.1 * ELASTIC, tolerance=1e-3, tangent=1 / 3)
    trial = case.solve(last=case.from_rest())
    assert case.iterations >= 5
    assert len(calls(case.problem)) == 1 + 2 * case.iterations
    exact = _case(0.1 * ELASTIC).solve()
    pulled_face = case.problem.pulled
    force, expected = (one.forces[pulled_face].sum() for one in (trial, exact))
    np.testing.assert_allclose(force, expected, rtol=2e-3)


def test_a_system_is_solved_as_well_as_newtons_method_leaves_its_residual(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The iterations are as many as with exact systems, and the last one ends at its target."""
    exact = _case(PLASTIC)
    with monkeypatch.context() as patch:
        patch.setattr(equilibrium, "_accuracy", lambda *_: RESIDUAL)
        expected = exact.solve()
    case, plain = _case(PLASTIC), Equilibrium.solve
    asked: list[tuple[float, float]] = []

    def solve(
        self: Equilibrium, trial: Trial, rhs: FloatArray, accuracy: float = RESIDUAL
    ) -> FloatArray:
        size, reaction = np.linalg.norm(rhs), np.linalg.norm(trial.forces[case.problem.prescribed])
        if reaction:  # The predictor begins at rest.
            asked.append((float(size / reaction), accuracy))
        return plain(self, trial, rhs, accuracy)

    monkeypatch.setattr(Equilibrium, "solve", solve)
    found = case.solve()
    *before, (last, finest) = asked
    assert case.iterations == len(asked) <= exact.iterations + 1
    assert before[0][1] == equilibrium.ROUGH
    assert any(accuracy == pytest.approx(0.3 * share) for share, accuracy in before)
    a_tenth = 1e-10 / last  # of the tolerance
    assert finest == pytest.approx(min(a_tenth, equilibrium.ROUGH))
    np.testing.assert_allclose(found.u, expected.u, atol=1e-8 * abs(expected.u).max())


def test_the_tangents_of_a_trial_go_once_they_are_in_the_matrix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of a large mesh they take more than all else of a trial; those of a solved step stay."""
    case, evaluate, plain = _case(PLASTIC), Equilibrium._evaluate, Equilibrium.solve
    tangents: list[weakref.ref[FloatArray]] = []
    alive: list[int] = []

    def watch(self: Equilibrium, *arguments: Any) -> Trial:
        trial = evaluate(self, *arguments)
        tangents.append(weakref.ref(trial.C))
        return trial

    def solve(
        self: Equilibrium, trial: Trial, rhs: FloatArray, accuracy: float = RESIDUAL
    ) -> FloatArray:
        alive.append(sum(one() is not None for one in tangents))
        return plain(self, trial, rhs, accuracy)

    monkeypatch.setattr(Equilibrium, "_evaluate", watch)
    monkeypatch.setattr(Equilibrium, "solve", solve)
    solved = case.solve()
    predictor, *iterations = alive
    assert predictor == 1 and iterations and not any(iterations)
    assert solved.C.size and solved.state.size


def test_the_last_linear_system_leaves_a_tenth_of_the_target() -> None:
    assert equilibrium._accuracy(1e-5, 1e-9, 1.0) == pytest.approx(1e-5)
    assert equilibrium._accuracy(1e-4, 1e-9, 1.0) == pytest.approx(3e-5)


def test_without_a_reaction_a_linear_system_is_solved_roughly() -> None:
    assert equilibrium._accuracy(1.0, 1e-9, 0.0) == equilibrium.ROUGH

"""Derivatives of steps in memory that is used again.

That they are those of the response is the claim of test_sensitivities.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.equilibrium import Equilibrium, Trial
from solver_adapters.bundled.fem.problem import Tangents, build_problem, build_tangents
from solver_adapters.bundled.fem.state import Instant
from solver_adapters.bundled.sensitivities import Differentiation
from solver_adapters.bundled.statistics import Statistics
from solver_adapters.interface import Direction
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import box, pulled

STEPS = 6


@dataclass(frozen=True, eq=False)
class Run:
    """Solved steps of 1 s, each from the one before: a history that can be differentiated."""

    equilibrium: Equilibrium
    tangents: Tangents
    trials: tuple[Trial, ...]
    motion_tangents: FloatArray

    def start(self) -> Instant:
        p, k = self.equilibrium.problem, self.tangents.count
        return Instant(
            0.0, np.zeros((p.n_nodes, 3)), np.zeros((p.points.grain.size, 9)), p.state, 0.0,
            np.zeros((p.n_nodes, 3, k)), self.tangents.state, np.zeros(k),
        )  # fmt: skip

    def derived(self, instant: Instant, step: int, differentiation: Differentiation) -> Instant:
        """The instant at the end of a step, with its derivatives."""
        trial = self.trials[step]
        du, dstate, dforce = differentiation.derive(
            instant, trial, 1.0, self.motion_tangents[step + 1], self.tangents.law
        )
        return Instant(step + 1.0, trial.u, trial.H, trial.state, 0.0, du, dstate, dforce)

    def instants(self, differentiation: Differentiation) -> Iterator[Instant]:
        """The ends of the steps, the memory of the differentiation used again and again."""
        instant = self.start()
        for step in range(STEPS):
            instant = self.derived(instant, step, differentiation)
            yield instant


@pytest.fixture
def run(measure: StrainMeasure) -> Run:
    """A pull beyond yield with hardening, along a constant, nodes, rotations and the motion."""
    material = Material(strain_measure=measure, Q=10.0)
    simulation = pulled(box(), material, tuple(np.linspace(0.0, 6e-3, STEPS + 1)[1:]))
    rng = np.random.default_rng(4)
    simulation = replace(
        simulation,
        directions=(
            Direction("constants", material={"tau0": 1.0, "b": 2.0}),
            Direction("points", points=0.1 * rng.normal(size=simulation.mesh.points.shape)),
            Direction("rotation", rotation=rng.normal(size=(2, 3))),
            Direction("motion", motion=rng.normal(size=simulation.motion.shape)),
        ),
    )
    problem = build_problem(simulation)
    tangents = build_tangents(simulation, problem)
    equilibrium = Equilibrium(problem, 1e-9, Statistics())
    run = Run(equilibrium, tangents, (), tangents.motion)
    instant, trials = run.start(), []
    for motion in problem.motion[1:]:
        trials.append(equilibrium.solve_step(instant, motion, 1.0, {}))
        end = trials[-1]
        instant = replace(instant, u=end.u, H=end.H, state=end.state)
    assert np.count_nonzero(trials[-1].slips) > 0
    return replace(run, trials=tuple(trials))


def test_memory_used_again_gives_what_fresh_memory_gives(run: Run) -> None:
    """Bit for bit, and other numbers in each step."""
    fresh = run.start()
    for step, instant in enumerate(run.instants(Differentiation(run.equilibrium, run.tangents))):
        last = replace(fresh, dstate=fresh.dstate.copy())
        fresh = run.derived(fresh, step, Differentiation(run.equilibrium, run.tangents))
        for name in ("du", "dstate", "dforce"):
            np.testing.assert_array_equal(getattr(instant, name), getattr(fresh, name))
        assert not np.array_equal(fresh.dstate, last.dstate)


def test_the_steps_after_a_kept_instant_go_on_in_one_memory(run: Run) -> None:
    differentiation = Differentiation(run.equilibrium, run.tangents)
    states = [instant.dstate for instant in run.instants(differentiation)]
    assert all(np.shares_memory(state, states[0]) for state in states)
    last = replace(run.start(), dstate=states[-1])
    differentiation.keep(last)
    assert not np.shares_memory(run.derived(last, 0, differentiation).dstate, states[-1])


def test_an_instant_that_was_not_kept_and_is_overtaken_is_refused(run: Run) -> None:
    differentiation = Differentiation(run.equilibrium, run.tangents)
    first, *_ = run.instants(differentiation)
    with pytest.raises(ValueError, match="not kept and has been overtaken"):
        run.derived(first, 1, differentiation)


def test_the_derivatives_of_a_kept_instant_stay_as_they_are(run: Run) -> None:
    differentiation = Differentiation(run.equilibrium, run.tangents)
    instant = run.derived(run.start(), 0, differentiation)
    kept, expected = instant, instant.dstate.copy()
    differentiation.keep(kept)
    for step in range(1, STEPS):
        instant = run.derived(instant, step, differentiation)
        assert not np.shares_memory(instant.dstate, kept.dstate)
    np.testing.assert_array_equal(kept.dstate, expected)


def test_the_first_instant_is_kept_unasked(run: Run) -> None:
    """A run starts from the derivatives of its state at rest, which belong to the problem."""
    expected = run.tangents.state.copy()
    for instant in run.instants(Differentiation(run.equilibrium, run.tangents)):
        assert not np.shares_memory(instant.dstate, run.tangents.state)
    np.testing.assert_array_equal(run.tangents.state, expected)

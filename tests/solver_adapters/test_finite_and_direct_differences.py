"""Finite differences beside the direct derivatives of the bundled solver, on one specimen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled import equilibrium
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.finite_differences import FiniteDifferences, shifted
from solver_adapters.interface import Capabilities, Direction, Progress, Response, Simulation
from solver_adapters.material import Material
from tools.boxes import box, pulled

Report = Callable[[Progress], None]


class Underived(BundledAdapter):
    """The bundled solver as if it had no derivatives, as exact as a usual code."""

    def __init__(self, tolerance: float = 1e-6) -> None:
        self.tolerance = tolerance
        self.asked: list[Simulation] = []
        self.answers: list[Response] = []

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), derivatives=False)

    def solve(
        self, simulation: Simulation, workspace: Path | None = None, progress: Report | None = None
    ) -> Response:
        assert not simulation.directions
        self.asked.append(simulation)
        self.answers.append(super().solve(replace(simulation, tolerance=self.tolerance), workspace))
        return self.answers[-1]


def _specimen() -> Simulation:
    """Two grains pulled beyond yield, unloaded and pulled again."""
    material = Material(Q=10.0, tau0_112=1.05, strain_measure="small")
    return pulled(box(), material, (0.001, 0.004, 0.0075, 0.0065, 0.004, 0.01), tolerance=1e-10)


CLOCK = Direction("clock", times=np.array([0.0, 0.0, 0.3, 0.8, 0.8, 0.9, 1.4]), scale=0.3)


def _directions(simulation: Simulation) -> tuple[Direction, ...]:
    """One of each kind; scales as the driver declares them."""
    x, y, z = simulation.mesh.points.T
    bump = (np.sin(1 + x) * np.sin(1 + y) * np.cos(z))[:, None] * [1.0, -0.5, 0.7]
    knot = np.zeros_like(simulation.motion)
    plus = simulation.mesh.points[simulation.motion_nodes, 1] > 2.0
    # An elongation knot: the motion grows up to the third instant and falls to the fifth.
    knot[1:5, plus, 1] = np.array([1.0, 2.0, 3.0, 1.5])[:, None] / 3
    turns = np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])
    return (
        Direction("tau0", material={"tau0": 1.0}, scale=40.0),
        Direction("d", material={"d": 1.0}, scale=1500.0),
        Direction("h_latent", material={"h_latent": 1.0}, scale=0.2),
        Direction("turn", rotation=turns, scale=0.035),
        Direction("gradient", lattice_gradient=turns, scale=0.02),
        Direction("knot", motion=knot, scale=0.01),
        Direction("nodes", points=bump, scale=0.1),
        CLOCK,
        Direction("mixed", material={"c": 40e3}, rotation=turns, motion=0.01 * knot, scale=0.03),
    )


@pytest.fixture(scope="module")
def specimen() -> Simulation:
    simulation = _specimen()
    return replace(simulation, directions=_directions(simulation))


@pytest.fixture(scope="module")
def direct(specimen: Simulation) -> Response:
    return BundledAdapter().solve(specimen)


def _worst(found: FloatArray, expected: FloatArray) -> float:
    return float(abs(found - expected).max() / abs(expected).max())


def test_they_agree_with_direct_differentiation_to_one_per_cent(
    specimen: Simulation, direct: Response
) -> None:
    solver = Underived()
    response = FiniteDifferences(solver).solve(specimen)
    assert response.notes == ()
    assert response.d_force.shape == direct.d_force.shape
    for k, direction in enumerate(specimen.directions):
        errors = (
            _worst(response.d_force[k], direct.d_force[k]),
            _worst(response.d_displacement[k], direct.d_displacement[k]),
        )
        assert max(errors) < 0.01, (direction.name, errors)
    # The asked run, two for each direction, two more where a constant is at its bound or a step
    # was changed.
    assert len(solver.asked) <= 1 + 3 * len(specimen.directions)
    np.testing.assert_array_equal(response.force, solver.answers[0].force)


@pytest.mark.parametrize("accuracy", [None, 2.0], ids=["cut", "refined"])
def test_the_runs_beside_repeat_the_steps_of_the_asked_one(
    specimen: Simulation, accuracy: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else the time errors of other steps would be taken for derivatives."""
    if accuracy is None:
        # An impatient Newton iteration cuts the step of first yield.
        monkeypatch.setattr(equilibrium, "MOST_NEWTON", 5)
    adaptive = replace(specimen, accuracy=accuracy, directions=specimen.directions[:2])
    solver = Underived()
    response = FiniteDifferences(solver).solve(adaptive)
    assert response.cuts + response.refinements > 0
    for simulation, answer in zip(solver.asked[1:], solver.answers[1:], strict=True):
        assert simulation.accuracy is None
        np.testing.assert_array_equal(simulation.steps, response.ends)
        np.testing.assert_allclose(answer.ends, response.ends, rtol=1e-12)
    assert response.notes == ()
    monkeypatch.undo()
    direct = BundledAdapter().solve(replace(adaptive, steps=response.ends, accuracy=None))
    for k in range(2):
        assert _worst(response.d_force[k], direct.d_force[k]) < 0.01


def test_time_steps_keep_their_share_of_an_interval_that_becomes_longer(
    specimen: Simulation,
) -> None:
    assert shifted(specimen, CLOCK, 0.5).steps is None
    steps = np.array([0.25, 1.0, 1.5, 2.0, 2.2, 3.0, 4.0, 5.0, 6.0])
    longer = shifted(replace(specimen, steps=steps), CLOCK, 0.5)
    np.testing.assert_allclose(longer.times, [0, 1, 2.15, 3.4, 4.4, 5.45, 6.7])
    assert longer.steps is not None
    expected = [0.25, 1, 1.575, 2.15, 2.4, 3.4, 4.4, 5.45, 6.7]
    np.testing.assert_allclose(longer.steps, expected)


def test_along_the_clock_the_runs_beside_take_the_steps_of_the_asked_one_on_their_own(
    specimen: Simulation,
) -> None:
    adaptive = replace(specimen, accuracy=2.0, directions=(CLOCK,))
    solver = Underived()
    response = FiniteDifferences(solver).solve(adaptive)
    assert response.refinements > 0 and response.notes == ()
    for simulation, answer in zip(solver.asked[1:], solver.answers[1:], strict=True):
        assert not np.array_equal(simulation.times, specimen.times)
        ends = np.interp(response.ends, specimen.times, simulation.times)
        np.testing.assert_allclose(answer.ends, ends, rtol=1e-12)
    direct = BundledAdapter().solve(adaptive)
    assert _worst(response.d_force[0], direct.d_force[0]) < 0.01
    assert _worst(response.d_displacement[0], direct.d_displacement[0]) < 0.01

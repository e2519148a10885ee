"""Finite differences: against the direct derivatives of the bundled solver, and on its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import (
    Capabilities,
    Direction,
    FloatArray,
    Progress,
    Response,
    Simulation,
)
from solver_adapters.material import Material
from tests.solver_adapters.boxes import box, pulled

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

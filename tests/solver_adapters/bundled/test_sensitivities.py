"""Derivatives of whole runs against central differences of the same runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.bundled import stepping
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Direction, Response, Simulation
from solver_adapters.material import MATERIAL_PARAMETERS, Material, StrainMeasure
from tests.solver_adapters.boxes import box, pulled

RNG = np.random.default_rng(11)
TOLERANCE = 1e-5
# Where truncation and rounding are about equal; relative for a material parameter. The
# response bends most along the motion: 5 nm strain this box to its yield.
MATERIAL_STEP = 2e-4
STEP = {"rotation": 1e-5, "points": 1e-5, "motion": 1e-7, "mixed": 1e-6}


def _simulation(measure: StrainMeasure, strains: tuple[float, ...]) -> Simulation:
    """Two grains pulled, unloaded and pulled again, converged to rounding."""
    material = Material(
        Q=10.0, tau0_112=1.05, tau0_grain2=0.95, C44_scale=0.97, strain_measure=measure
    )
    return pulled(box(), material, strains, tolerance=1e-11)


def _material(name: str) -> Direction:
    return Direction(name, material={name: 1.0})


def _directions(simulation: Simulation) -> tuple[Direction, ...]:
    nodes = simulation.mesh.points
    bump = np.prod(np.sin(nodes + 0.3), axis=1, keepdims=True)
    motion = np.zeros_like(simulation.motion)
    motion[1:] = RNG.normal(size=simulation.motion.shape[1:])
    mixed = Direction(
        "mixed",
        material={"tau0": 2.0, "c": -900.0},
        rotation=np.array([[0.1, 0.0, 0.2], [0.0, -0.3, 0.1]]),
        motion=0.1 * motion,
        points=0.5 * bump * [0.2, 0.0, 1.0],
    )
    return (
        *(_material(name) for name in MATERIAL_PARAMETERS),
        Direction("rotation", rotation=np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])),
        Direction("motion", motion=motion),
        Direction("points", points=bump * [1.0, -0.5, 0.7]),
        mixed,
    )


def _moved(simulation: Simulation, direction: Direction, step: float) -> Simulation:
    """The simulation at a distance along a direction."""
    changes = {
        name: getattr(simulation.material, name) + step * rate
        for name, rate in direction.material.items()
    }
    material = replace(simulation.material, **changes)
    mesh, orientations, motion = simulation.mesh, simulation.orientations, simulation.motion
    if direction.rotation is not None:
        turns = np.stack([rotation_vector_matrix(step * vector) for vector in direction.rotation])
        orientations = turns @ orientations
    if direction.motion is not None:
        motion = motion + step * direction.motion
    if direction.points is not None:
        mesh = replace(mesh, points=mesh.points + step * direction.points)
    return replace(
        simulation,
        mesh=mesh,
        material=material,
        orientations=orientations,
        motion=motion,
        directions=(),
    )


def _check(simulation: Simulation, expected_cuts: Callable[[int], bool]) -> None:
    directions = _directions(simulation)
    response = BundledAdapter().solve(replace(simulation, directions=directions))
    assert expected_cuts(response.cuts)
    for k, direction in enumerate(directions):
        if direction.name in STEP:
            step = STEP[direction.name]
        else:
            step = MATERIAL_STEP * getattr(simulation.material, direction.name)
        high, low = (
            BundledAdapter().solve(_moved(simulation, direction, sign * step)) for sign in (1, -1)
        )
        assert high.steps == low.steps == response.steps
        _compare(response, k, direction.name, high, low, 2 * step)


def _compare(
    response: Response, k: int, name: str, high: Response, low: Response, width: float
) -> None:
    pairs = (
        (response.d_force[k], (high.force - low.force) / width),
        (response.d_displacement[k], (high.displacement - low.displacement) / width),
    )
    for found, expected in pairs:
        scale = abs(expected).max()
        assert scale > 0
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=TOLERANCE * scale, err_msg=f"along {name}"
        )


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_derivatives_of_a_cycle_are_its_difference_quotients(measure: StrainMeasure) -> None:
    simulation = _simulation(measure, (0.001, 0.004, 0.0075, 0.0065, 0.004, 0.01))
    _check(simulation, lambda cuts: cuts == 0)


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_derivatives_pass_through_a_step_that_was_cut(
    measure: StrainMeasure, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An impatient Newton iteration cuts the step of first yield."""
    monkeypatch.setattr(stepping, "MOST_NEWTON", 6)
    _check(_simulation(measure, (0.004, 0.0035)), lambda cuts: cuts > 0)


def test_asking_for_derivatives_does_not_change_the_answer() -> None:
    simulation = _simulation("small", (0.004, 0.003))
    plain = BundledAdapter().solve(simulation)
    asked = BundledAdapter().solve(replace(simulation, directions=(_material("tau0"),)))
    np.testing.assert_array_equal(asked.force, plain.force)
    np.testing.assert_array_equal(asked.displacement, plain.displacement)

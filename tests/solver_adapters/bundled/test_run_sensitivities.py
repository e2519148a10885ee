"""Derivatives of whole runs against central differences of the same runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled import equilibrium
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import BCC, BCC48, rotation_vector_matrix
from solver_adapters.interface import Direction, Integration, Response, Simulation
from solver_adapters.material import (
    MATERIAL_DECLARATIONS,
    MATERIAL_PARAMETERS,
    TAU0_BANDS,
    Material,
    StrainMeasure,
    of_other_crystals,
)
from tools.boxes import BOXES, box, hex_box, pulled

RNG = np.random.default_rng(11)
TOLERANCE = 1e-5
# Small, as systems that start or stop to relax bend the response; relative for a material
# parameter. The response bends most along the motion: 5 nm strain this box to its yield.
MATERIAL_STEP = 2e-5
# What a stress that varies inside a grain changes is small: rounding counts in shorter steps.
MODE_STEP = 2e-4
# Parameters that cannot be below their null.
NOT_NEGATIVE = ("h_latent", "Q_latent", "c2")
SCHEMES = pytest.mark.parametrize("integration", ["exponential", "backward_euler"])
STEP = {
    "rotation": 1e-5,
    "gradient": 1e-5,
    "points": 1e-5,
    "motion": 2e-8,
    "mixed": 3e-7,
    "times": 1e-4,
    "eigenstrain": 4e-8,  # its own scale asks for a step so small that rounding counts
}


BASELINE = Material(Q=10.0, tau0_112=1.05, tau0_grain2=0.95, C44_scale=0.97)
GENERAL = replace(
    BASELINE,
    tau0_antitwinning=1.1,
    a1=0.15,
    h_latent=0.3,
    Q_latent=2.0,
    c2=2000.0,
    x0=5e-5,
    eigenstrain=3e-4,
    skin_tau0=1.2,
    tau0_grain1_slope_Y=0.1,
    tau0_grain1_bend_Y=-0.1,
    tau0_grain1_slope_X=0.05,
    tau0_grain2_slope_Y=-0.1,
    tau0_grain2_bend_Y=0.1,
    tau0_grain2_slope_X=0.05,
)
BANDED = replace(GENERAL, tau0_grain1_band=-0.07, tau0_grain2_band=0.06)
COMPANIONS = {"d2", "skin_thickness", *(name for band in TAU0_BANDS for name in band[1:])}
# Steps of parameters whose value gives no scale.
SCALES = {parameter.name: parameter.scale for parameter in MATERIAL_DECLARATIONS}


def _simulation(
    measure: StrainMeasure, strains: tuple[float, ...], material: Material = BASELINE
) -> Simulation:
    """Two grains pulled, unloaded and pulled again, converged to rounding."""
    mesh = box()
    # Without symmetry no point is as near to one side as to another.
    x, y, z = mesh.points.T
    bent = mesh.points + 0.05 * np.column_stack([np.sin(1.3 * y + z), 0 * y, np.cos(x - 0.7 * y)])
    return pulled(
        replace(mesh, points=bent),
        replace(material, strain_measure=measure),
        strains,
        tolerance=1e-11,
    )


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
        lattice_gradient=np.array([[0.2, 0.1, 0.0], [0.1, 0.0, -0.3]]),
        motion=0.1 * motion,
        points=0.5 * bump * [0.2, 0.0, 1.0],
        times=0.3 * _times(simulation),
    )
    return (
        *(_material(n) for n in MATERIAL_PARAMETERS if n not in of_other_crystals(BCC)),
        Direction("rotation", rotation=np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])),
        Direction("gradient", lattice_gradient=np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])),
        Direction("motion", motion=motion),
        Direction("points", points=bump * [1.0, -0.5, 0.7]),
        Direction("times", times=_times(simulation)),
        mixed,
    )


def _times(simulation: Simulation) -> FloatArray:
    """A change of the instants: another one of each interval."""
    return np.asarray(np.sin(0.7 + 1.3 * simulation.times))


def _moved(simulation: Simulation, direction: Direction, step: float) -> Simulation:
    """The simulation at a distance along a direction."""
    changes = {
        name: getattr(simulation.material, name) + step * rate
        for name, rate in direction.material.items()
    }
    material = replace(simulation.material, **changes)
    mesh, orientations, motion = simulation.mesh, simulation.orientations, simulation.motion
    gradient = simulation.lattice_gradient
    if direction.lattice_gradient is not None:
        start = np.zeros_like(direction.lattice_gradient) if gradient is None else gradient
        gradient = start + step * direction.lattice_gradient
    if direction.rotation is not None:
        turns = np.stack([rotation_vector_matrix(step * vector) for vector in direction.rotation])
        orientations = turns @ orientations
    if direction.motion is not None:
        motion = motion + step * direction.motion
    if direction.points is not None:
        mesh = replace(mesh, points=mesh.points + step * direction.points)
    times, steps = simulation.times, simulation.steps
    if direction.times is not None:
        times = times + step * direction.times
        steps = None if steps is None else np.interp(steps, simulation.times, times)
    return replace(
        simulation,
        mesh=mesh,
        material=material,
        orientations=orientations,
        lattice_gradient=gradient,
        times=times,
        steps=steps,
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
            value = getattr(simulation.material, direction.name)
            mode = "_slope_" in direction.name or "_bend_" in direction.name
            share = MODE_STEP if mode else MATERIAL_STEP
            step = share * (value or SCALES[direction.name])
            if value == 0.0 and direction.name in NOT_NEGATIVE:
                _compare(response, k, direction.name, _forward(simulation, direction, step))
                continue
        _compare(response, k, direction.name, _central(simulation, direction, step, response))


def _forward(simulation: Simulation, direction: Direction, step: float) -> tuple[FloatArray, ...]:
    """One-sided differences of force and displacement, of second order."""
    runs = [BundledAdapter().solve(_moved(simulation, direction, m * step)) for m in (0, 1, 2)]
    assert len({run.steps for run in runs}) == 1
    weights = (-1.5 / step, 2.0 / step, -0.5 / step)
    pairs = [(w * run.force, w * run.displacement) for w, run in zip(weights, runs, strict=True)]
    return tuple(sum(parts[1:], parts[0]) for parts in zip(*pairs, strict=True))


def _central(
    simulation: Simulation, direction: Direction, step: float, response: Response
) -> tuple[FloatArray, FloatArray]:
    """Central differences of force and displacement along a direction, in the same steps."""
    high, low = (
        BundledAdapter().solve(_moved(simulation, direction, sign * step)) for sign in (1, -1)
    )
    assert high.steps == low.steps == response.steps
    return (
        (high.force - low.force) / (2 * step),
        (high.displacement - low.displacement) / (2 * step),
    )


def _compare(
    response: Response,
    k: int,
    name: str,
    slope: tuple[FloatArray, ...],
    tolerance: float = TOLERANCE,
) -> None:
    for found, expected in zip(
        (response.d_force[k], response.d_displacement[k]), slope, strict=True
    ):
        scale = abs(expected).max()
        if name in COMPANIONS and scale == 0:
            # Without effect while what they belong to is at its null.
            assert not found.any()
            continue
        assert scale > 0
        np.testing.assert_allclose(
            found, expected, rtol=0, atol=tolerance * scale, err_msg=f"along {name}"
        )


@pytest.mark.parametrize("material", [BASELINE, BANDED], ids=["baseline", "general"])
def test_derivatives_of_a_cycle_are_its_difference_quotients(
    measure: StrainMeasure, material: Material
) -> None:
    simulation = _simulation(measure, (0.001, 0.004, 0.0075, 0.0065, 0.004, 0.01), material)
    _check(simulation, lambda cuts: cuts == 0)


@pytest.mark.usefixtures("exact_newton")
def test_derivatives_pass_through_a_step_that_was_cut(
    measure: StrainMeasure, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An impatient Newton iteration cuts the step of first yield."""
    monkeypatch.setattr(equilibrium, "MOST_NEWTON", 6)
    _check(_simulation(measure, (0.004, 0.0035)), lambda cuts: cuts > 0)


def test_derivatives_of_a_mesh_of_hexahedra_are_difference_quotients(
    measure: StrainMeasure,
) -> None:
    material = Material(strain_measure=measure)
    simulation = pulled(hex_box(), material, (0.002, 0.006), tolerance=1e-12)
    rotation = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]])
    points = 0.1 * np.sin(simulation.mesh.points[:, [1, 2, 0]])
    directions = (
        _material("tau0"),
        Direction("motion", motion=simulation.motion),
        Direction("rotation", rotation=rotation),
        Direction("points", points=points),
    )
    response = BundledAdapter().solve(replace(simulation, directions=directions))
    for k, (direction, step) in enumerate(zip(directions, (1e-3, 1e-5, 1e-5, 1e-5), strict=True)):
        _compare(response, k, direction.name, _central(simulation, direction, step, response))


@pytest.mark.slow  # these kernels are compiled for it alone
def test_derivatives_of_a_crystal_of_48_systems_are_difference_quotients(
    measure: StrainMeasure,
) -> None:
    material = Material(slip_systems=BCC48, tau0_123=0.9, Q=10.0, h_latent=0.3, c2=2000.0, x0=5e-5)
    simulation = _simulation(measure, (0.002, 0.006, 0.005, 0.008), material)
    rotation = np.array([[0.3, -0.2, 0.5], [-0.1, 0.4, 0.2]])
    directions = (
        *map(_material, ("tau0", "tau0_112", "tau0_123", "K", "d", "Q", "h_latent", "c2", "x0")),
        Direction("motion", motion=simulation.motion),
        Direction("rotation", rotation=rotation),
    )
    asked = replace(simulation, directions=directions, cell_fields=True)
    response = BundledAdapter().solve(asked)
    for k, direction in enumerate(directions):
        step = MATERIAL_STEP * getattr(material, direction.name, 0.5)
        _compare(response, k, direction.name, _central(simulation, direction, step, response))
    assert response.cells is not None
    slipped = response.cells.accumulated_slip[-1].max(axis=0)
    assert slipped.shape == (48,) and (slipped > 0.0).sum() > 24


@SCHEMES
@pytest.mark.parametrize("name", ["Q", "Q_latent"])
def test_the_onset_of_latent_hardening_is_felt_where_there_is_none_yet(
    measure: StrainMeasure, integration: Integration, name: str
) -> None:
    """At Q = 0 the law is uncoupled, its derivatives along Q and Q_latent are not."""
    simulation = _simulation(measure, (0.002, 0.004, 0.006, 0.008), Material(h_latent=1.4))
    simulation = replace(simulation, integration=integration)
    direction = _material(name)
    response = BundledAdapter().solve(replace(simulation, directions=(direction,)))
    _compare(response, 0, name, _forward(simulation, direction, 1e-3))


@SCHEMES
def test_derivatives_with_latent_hardening_alone_are_difference_quotients(
    measure: StrainMeasure, integration: Integration
) -> None:
    """Q = 0: the accumulated slips are carried, and b acts, for Q_latent."""
    simulation = _simulation(measure, (0.004, 0.0075, 0.004, 0.008), Material(Q_latent=4.0))
    simulation = replace(simulation, integration=integration)
    directions = tuple(map(_material, ("tau0", "Q_latent", "b")))
    response = BundledAdapter().solve(replace(simulation, directions=directions))
    for k, direction in enumerate(directions):
        step = MATERIAL_STEP * getattr(simulation.material, direction.name)
        _compare(response, k, direction.name, _central(simulation, direction, step, response))


def _held(measure: StrainMeasure, integration: Integration) -> Simulation:
    """Pulled beyond yield and held, unloaded into compression and held, two steps each."""
    simulation = _simulation(measure, (0.004, 0.008, 0.008, 0.008, -0.001, -0.001), GENERAL)
    times = np.array([0.0, 4.0, 8.0, 12.0, 38.0, 42.0, 72.0])
    return replace(simulation, times=times, integration=integration, steps_per_interval=2)


HOLDS = Direction("holds", times=np.array([0.0, 0.0, 0.0, 2 / 15, 1.0, 1.0, 2.0]))


def _along_holds(
    simulation: Simulation, step: float, response: Response
) -> tuple[FloatArray, FloatArray]:
    """Central differences of sixth order along the holds.

    A second more in a hold moves the surface by some 1e-7 µm. Displacements of 1e-2 µm are
    rounded at 1e-14 µm, so that only long steps keep six digits.
    """
    weights = (1.5, -0.6, 0.1)
    slopes = [_central(simulation, HOLDS, m * step, response) for m in (1, 2, 3)]
    force, displacement = (
        sum((w * part for w, part in zip(weights, parts, strict=True)), np.zeros(()))
        for parts in zip(*slopes, strict=True)
    )
    return force, displacement


@SCHEMES
def test_derivatives_along_the_lengths_of_holds_are_difference_quotients(
    measure: StrainMeasure, integration: Integration
) -> None:
    simulation = _held(measure, integration)
    response = BundledAdapter().solve(replace(simulation, directions=(HOLDS,)))
    assert not response.d_force[0, :3].any() and response.d_force[0, 3:].all()
    _compare(response, 0, "holds", _along_holds(simulation, 1.0, response), 1e-6)


def test_derivatives_along_the_times_keep_the_share_of_given_steps(
    measure: StrainMeasure,
) -> None:
    """Steps that refined themselves, as the difference quotient takes them too."""
    asked = replace(_held(measure, "exponential"), accuracy=2.0, directions=(HOLDS,))
    refined = BundledAdapter().solve(asked)
    assert refined.refinements > 0
    given = replace(asked, accuracy=None, steps=refined.ends)
    response = BundledAdapter().solve(given)
    for found, expected in ((response, refined), (refined, response)):
        _compare(found, 0, "holds", (expected.d_force[0], expected.d_displacement[0]), 1e-7)
    _compare(response, 0, "holds", _along_holds(given, 0.3, response), 1e-6)


@SCHEMES
def test_a_longer_test_is_one_of_less_viscosity(
    measure: StrainMeasure, integration: Integration
) -> None:
    """Times enter with K alone, as Δt K⁻ⁿ."""
    simulation = _held(measure, integration)
    K, n = simulation.material.K, simulation.material.n
    directions = (Direction("times", times=simulation.times), _material("K"))
    response = BundledAdapter().solve(replace(simulation, directions=directions))
    expected = -K / n * response.d_force[1], -K / n * response.d_displacement[1]
    _compare(response, 0, "times", expected, 1e-12)


def test_asking_for_derivatives_does_not_change_the_answer() -> None:
    simulation = _simulation("small", (0.004, 0.003))
    plain = BundledAdapter().solve(simulation)
    asked = BundledAdapter().solve(replace(simulation, directions=(_material("tau0"),)))
    # The linear systems start from other factors: their solutions agree to their accuracy.
    np.testing.assert_allclose(asked.force, plain.force, rtol=1e-8)
    np.testing.assert_allclose(asked.displacement, plain.displacement, rtol=1e-8)


def test_derivatives_with_mean_dilatation_are_difference_quotients(
    kind: str, measure: StrainMeasure
) -> None:
    material = Material(strain_measure=measure, a1=0.1)
    simulation = pulled(BOXES[kind](jitter=0.1), material, (0.002, 0.006), tolerance=1e-12)
    simulation = replace(simulation, mean_dilatation=True)
    points = 0.1 * np.sin(simulation.mesh.points[:, [1, 2, 0]])
    spins = np.array([[0.3, -0.2, 0.5], [0.1, 0.4, -0.3]])
    directions = (
        _material("tau0"),
        _material("C11"),
        Direction("motion", motion=simulation.motion),
        Direction("rotation", rotation=spins),
        Direction("points", points=points),
        Direction("gradient", lattice_gradient=spins),
    )
    response = BundledAdapter().solve(replace(simulation, directions=directions))
    # Node positions in shorter steps would show the slip by which a point may be wrong: 1e-13 is
    # 1e-11 of a force.
    steps = (1e-3, 10.0, 1e-5, 1e-5, 1e-4, 1e-5)
    for k, (direction, step) in enumerate(zip(directions, steps, strict=True)):
        _compare(response, k, direction.name, _central(simulation, direction, step, response))

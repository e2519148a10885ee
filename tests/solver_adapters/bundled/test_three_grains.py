"""Three grains in a row: what is exact of them, and CalculiX beside the bundled solver."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshes.arrays import FloatArray
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.crystal import FCC, bunge_matrix
from solver_adapters.finite_differences import shifted
from solver_adapters.interface import Direction, Simulation
from solver_adapters.material import Material, with_parameters
from tests.solver_adapters.bundled.bars import ROTATION, STRAINS, TIMES, bar
from tests.solver_adapters.calculix.runs import largest, needs_ccx, run
from tools.boxes import pulled, uniaxial

FLAT = tuple(GrainBoundary((0.0, y, 0.0), (0.0, 1.0, 0.0)) for y in (2.0, 4.0))
LEANING = tuple(
    GrainBoundary((0.0, y, 0.0), normal) for y, normal in ((2.0, (0.1, 1.0, 0.2)), (4.2, (0, 1, 0)))
)
COPPER = Material(
    C11=168.4e3, C12=121.4e3, C44=75.4e3, tau0=20.0, slip_systems=FCC, strain_measure="small"
)
ORIENTATIONS = np.stack(
    [bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150), bunge_matrix(30, 20, 10)]
)


def geometry(boundaries: tuple[GrainBoundary, ...]) -> PrismGeometry:
    return PrismGeometry(6.0, 3.0, 2.0, boundaries, 3.0)


@pytest.mark.parametrize("kind", ["tet10", "hex20"])
def test_three_grains_of_one_orientation_carry_the_section_times_the_stress_of_a_point(
    kind: str,
) -> None:
    asked = bar(geometry(LEANING), kind, COPPER)  # type: ignore[arg-type]
    asked = replace(asked, orientations=np.stack([ROTATION] * 3))
    found = BundledAdapter().solve(asked).force
    of_one = BundledAdapter().solve(uniaxial(COPPER, ROTATION, TIMES, STRAINS)).force
    np.testing.assert_allclose(found, 6.0 * of_one, rtol=1e-6, atol=6e-6)
    assert abs(of_one).max() > 40.0


def test_three_grains_of_one_orientation_are_one_grain_to_rounding() -> None:
    """The motion of clamped ends, which no point solution has, on cells at the same places."""
    three = generate(geometry(FLAT), 2.0, "hex20", layers=(2, 2, 2))
    one = generate(geometry(()), 2.0, "hex20", layers=(6,))
    asked = [replace(pulled(mesh, COPPER, (1e-3, 2e-3)), orientations=np.stack(turns))
             for mesh, turns in ((three, [ROTATION] * 3), (one, [ROTATION]))]  # fmt: skip
    found, expected = (BundledAdapter().solve(one).force for one in asked)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_layers_that_cannot_widen_are_springs_in_series() -> None:
    """Elastic, of the cube and of the cube turned by 45° about X, without shear.

    The stiffness along Y is C11, and (C11 + C12)/2 + C44; all nodes are held along X and Z.
    """
    mesh = generate(geometry(FLAT), 2.0, "hex20", layers=(1, 2, 1))
    turned = np.array([[1, 0, 0], [0, 1, -1], [0, 1, 1]]) / np.sqrt([[1], [2], [2]])
    elastic = replace(COPPER, tau0=1e9)
    nodes = np.arange(len(mesh.points))
    ends = np.isin(nodes, np.concatenate([mesh.nodes["S_PLUS"], mesh.nodes["S_MINUS"]]))
    mask = np.ones((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = ends
    motion = np.zeros((2, len(nodes), 3))
    motion[1, mesh.nodes["S_PLUS"], 1] = 6e-3
    asked = Simulation(
        mesh=mesh,
        material=elastic,
        orientations=np.stack([np.eye(3), turned, np.eye(3)]),
        times=np.array([0.0, 1.0]),
        motion_nodes=nodes,
        motion_mask=mask,
        motion=motion,
        output=np.arange(2),
        output_nodes=mesh.nodes["S_PLUS"],
    )
    cube, across = 168.4e3, (168.4e3 + 121.4e3) / 2 + 75.4e3
    stress = 6e-3 / (2.0 / cube + 2.0 / across + 2.0 / cube)
    assert BundledAdapter().solve(asked).force[1] == pytest.approx(6.0 * stress, rel=1e-9)


def three_grains(mesh: PrismMesh, strains: tuple[float, ...], material: Material) -> Simulation:
    made = pulled(mesh, material, strains, 0.25)
    return replace(made, orientations=ORIENTATIONS, integration="backward_euler")


def central(asked: Simulation, direction: Direction, step: float) -> FloatArray:
    runs = (BundledAdapter().solve(shifted(asked, direction, sign * step)) for sign in (1, -1))
    plus, minus = (one.force for one in runs)
    return np.asarray((plus - minus) / (2 * step))


def test_the_force_changes_with_the_third_grain_as_its_derivative_says() -> None:
    mesh = generate(geometry(LEANING), 2.0, "hex20", layers=(1, 1, 1))
    asked = three_grains(mesh, (5e-4, 1e-3, 2e-3), replace(COPPER, tau0_grains=(1.2,)))
    turn = np.zeros((3, 3))
    turn[2, 0] = 1.0
    along = (
        Direction("tau0_grain3", material={"tau0_grain3": 1.0}),
        Direction("turn", rotation=turn),
    )
    found = BundledAdapter().solve(replace(asked, directions=along)).d_force
    for direction, derivative in zip(along, found, strict=True):
        expected = central(asked, direction, 1e-4)
        np.testing.assert_allclose(derivative, expected, rtol=1e-4, atol=1e-5 * largest(expected))
        assert largest(expected) > 1.0


INSIDE = {
    "tau0_grain3_slope_Y": 0.1, "tau0_grain3_bend_Y": -0.1, "tau0_grain3_slope_X": 0.05,
    "tau0_grain3_band": -0.5, "tau0_grain3_band_middle": 0.2, "tau0_grain3_band_half_width": 0.3,
}  # fmt: skip


@pytest.mark.parametrize("varies", [True, False])
def test_what_varies_inside_a_third_grain_is_what_varies_inside_a_second_one(varies: bool) -> None:
    """The first two of one orientation are one grain by their numbers, on the same cells."""
    mesh = generate(geometry(LEANING), 2.0, "hex20", layers=(1, 1, 2))
    inside = INSIDE if varies else dict.fromkeys(INSIDE, 0.0) | {"tau0_grain3_band_half_width": 0.3}
    later = three_grains(mesh, (1e-3, 2e-3), with_parameters(COPPER, inside))
    later = replace(later, orientations=ORIENTATIONS[[0, 0, 2]])
    as_second = {name.replace("grain3", "grain2"): value for name, value in inside.items()}
    second = replace(
        later,
        mesh=replace(mesh, grain=np.maximum(mesh.grain - 1, 0)),
        orientations=ORIENTATIONS[[0, 2]],
        material=with_parameters(COPPER, as_second),
    )
    found, expected = (
        BundledAdapter().solve(
            replace(one, directions=tuple(Direction(name, material={name: 1.0}) for name in names))
        )
        for one, names in ((later, inside), (second, as_second))
    )
    np.testing.assert_allclose(found.force, expected.force, rtol=1e-12)
    np.testing.assert_allclose(
        found.d_force, expected.d_force, rtol=0, atol=1e-9 * largest(expected.d_force)
    )
    assert (abs(found.d_force).max(axis=1) > 0.01).tolist() == [True] * 4 + 2 * [varies]


def test_nodes_that_move_take_the_band_of_a_third_grain_along() -> None:
    mesh = generate(geometry(LEANING), 2.0, "hex20", layers=(1, 1, 2))
    asked = three_grains(mesh, (1e-3, 2e-3), with_parameters(COPPER, INSIDE))
    moved = np.zeros_like(mesh.points)
    moved[:, 1] = np.sin(np.pi * mesh.points[:, 1] / 6.0)
    direction = Direction("nodes", points=moved)
    found = BundledAdapter().solve(replace(asked, directions=(direction,))).d_force[0]
    expected = central(asked, direction, 1e-4)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4 * largest(expected))
    assert largest(expected) > 1.0


@needs_ccx
def test_three_grains_of_copper_carry_in_calculix_what_they_carry_here(tmp_path: Path) -> None:
    mesh = generate(geometry(LEANING), 2.5)
    law = replace(COPPER, tau0_grain2=1.1, tau0_grains=(1.3,))
    asked = three_grains(mesh, tuple(np.linspace(0.0, 0.002, 11)[1:]), law)
    found = run(asked, tmp_path)
    expected = BundledAdapter().solve(replace(asked, steps=found.ends))
    assert largest(found.force - expected.force) < 1e-3 * largest(expected.force)
    assert largest(found.displacement - expected.displacement) < 1e-4  # µm

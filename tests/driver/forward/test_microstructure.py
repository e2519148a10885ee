from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.forward.microstructure import Microstructure, build_microstructure
from driver.parameters.microstructure import (
    geometry_declarations,
    lattice_declarations,
    orientation_declarations,
)
from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import SolverError

NULL = {
    p.name: p.null
    for p in (*geometry_declarations(2), *orientation_declarations(2), *lattice_declarations(2))
}
TURNED = dict(
    zip(
        [p.name for p in orientation_declarations(2)],
        (0.3, -0.2, 0.1, -0.15, 0.25, 0.4, 0.2, 0.35, -0.3),
        strict=True,
    )
)
MEASURED = np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150)])


@pytest.fixture(scope="module")
def two_grains() -> Microstructure:
    geometry = PrismGeometry(4.0, 2.0, 1.7, (GrainBoundary((0, 2, 0), (0.1, 1, 0.2)),))
    return build_microstructure(generate(geometry, 1.2), geometry, MEASURED)


@pytest.mark.parametrize("values", [NULL, NULL | TURNED], ids=["null", "turned"])
@pytest.mark.parametrize("name", TURNED)
def test_the_rotation_rate_is_that_of_the_orientations(
    two_grains: Microstructure, values: dict[str, float], name: str
) -> None:
    h = 1e-6
    above, below = (two_grains.rotated(values | {name: values[name] + s}) for s in (h, -h))
    # dR/dp · Rᵀ is skew: its axial vector is the rate in the specimen frame.
    spin = (above - below) / (2 * h) @ two_grains.rotated(values).transpose(0, 2, 1)
    np.testing.assert_allclose(spin, -spin.transpose(0, 2, 1), atol=1e-9)
    axial = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    np.testing.assert_allclose(two_grains.rotation_rate(values, name), axial, atol=1e-9)


def test_the_frame_turns_what_the_grains_have_turned(two_grains: Microstructure) -> None:
    quarter = np.pi / 2
    values = NULL | {"rotation_grain1_x": quarter, "rotation_frame_z": quarter}
    about_x = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    about_z = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    first, second = two_grains.rotated(values)
    np.testing.assert_allclose(first, about_z @ about_x @ MEASURED[0], atol=1e-12)
    np.testing.assert_allclose(second, about_z @ MEASURED[1], atol=1e-12)


def test_at_the_null_the_mesh_is_the_drawn_one(two_grains: Microstructure) -> None:
    assert two_grains.moved_mesh(NULL) is two_grains.mesh
    np.testing.assert_allclose(two_grains.rotated(NULL), MEASURED, atol=1e-15)


@pytest.mark.parametrize("name", [p.name for p in geometry_declarations(2)])
def test_nodes_move_along_the_velocity_of_a_parameter(
    two_grains: Microstructure, name: str
) -> None:
    moved = two_grains.moved_mesh(NULL | {name: 0.1})
    np.testing.assert_allclose(
        moved.points - two_grains.mesh.points, 0.1 * two_grains.velocities[name], atol=1e-12
    )
    assert np.abs(two_grains.velocities[name]).max() > 0.1


def test_changes_of_geometry_add_up(two_grains: Microstructure) -> None:
    both = two_grains.moved_mesh(NULL | {"boundary_shift": 0.2, "depth_scale": 0.1}).points
    one = two_grains.moved_mesh(NULL | {"boundary_shift": 0.2}).points
    other = two_grains.moved_mesh(NULL | {"depth_scale": 0.1}).points
    np.testing.assert_allclose(both, one + other - two_grains.mesh.points, atol=1e-12)


def test_a_change_that_turns_cells_inside_out_is_refused(two_grains: Microstructure) -> None:
    with pytest.raises(SolverError, match="inverts"):
        two_grains.moved_mesh(NULL | {"boundary_shift": 2.5})


def test_a_velocity_of_another_shape_is_a_fault_and_no_failed_simulation(
    two_grains: Microstructure,
) -> None:
    wrong = replace(two_grains, velocities={"boundary_shift": np.zeros((3, 3))})
    with pytest.raises(ValueError, match="broadcast"):
        wrong.moved_mesh(NULL | {"boundary_shift": 0.2})


def test_a_single_grain_has_neither_boundary_nor_second_orientation() -> None:
    geometry = PrismGeometry(4.0, 2.0, 1.7)
    single = build_microstructure(generate(geometry, 1.5), geometry, MEASURED[:1])
    grain = {f"{what}_grain1_{axis}" for what in ("rotation", "lattice_gradient") for axis in "xyz"}
    assert single.parameters == {"depth_scale", "apex_shift"} | grain
    assert single.rotated(NULL | {"rotation_grain1_y": 0.1}).shape == (1, 3, 3)


def test_the_lattice_gradient_is_linear_in_its_parameters(two_grains: Microstructure) -> None:
    assert two_grains.lattice_gradient(NULL) is None
    names = [p.name for p in lattice_declarations(2)]
    assert set(names) <= two_grains.parameters
    values = NULL | dict(zip(names, (1e-3, -2e-3, 3e-3, 4e-3, -5e-3, 6e-3), strict=True))
    found = two_grains.lattice_gradient(values)
    assert found is not None
    np.testing.assert_allclose(found, [[1e-3, -2e-3, 3e-3], [4e-3, -5e-3, 6e-3]])
    rates = sum(values[name] * two_grains.lattice_gradient_rate(name) for name in names)
    np.testing.assert_allclose(rates, found)


def test_three_grains_have_a_turn_and_a_gradient_each_and_their_boundaries_four_motions() -> None:
    planes = tuple(GrainBoundary((0, y, 0), (0.1, 1, 0.2)) for y in (1.3, 2.6))
    geometry = PrismGeometry(4.0, 2.0, 1.7, planes)
    measured = np.stack([*MEASURED, bunge_matrix(30, 20, 10)])
    three = build_microstructure(generate(geometry, 1.2), geometry, measured)
    declared = (*geometry_declarations(3), *orientation_declarations(3), *lattice_declarations(3))
    null = {p.name: p.null for p in declared}
    assert three.parameters == set(null)
    third = "rotation_grain3_x"
    np.testing.assert_allclose(three.rotated(null | {third: 0.1})[:2], MEASURED, atol=1e-15)
    np.testing.assert_allclose(three.rotation_rate(null, third), [[0] * 3, [0] * 3, [1, 0, 0]])
    rate = three.lattice_gradient_rate("lattice_gradient_grain3_z")
    np.testing.assert_allclose(rate, [[0] * 3, [0] * 3, [0, 0, 1]])
    far, near = (three.mesh.cells[three.mesh.grain == grain] for grain in (0, 2))
    moved = three.moved_mesh(null | {"boundary2_shift": 0.1}).points - three.mesh.points
    assert abs(moved[far]).max() < 1e-12 and moved[near, 1].max() == pytest.approx(0.1)

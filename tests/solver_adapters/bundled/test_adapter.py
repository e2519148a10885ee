"""What mechanics demands of any solution, on boxes of a few tetrahedra."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.law import local_parameters
from solver_adapters.bundled.points import Points
from solver_adapters.crystal import rotation_vector_matrix, schmid_tensors
from solver_adapters.interface import (
    FloatArray,
    Progress,
    Response,
    Simulation,
    SolverError,
    UnsupportedError,
)
from solver_adapters.material import Material, StrainMeasure
from tests.solver_adapters.boxes import ORIENTATIONS, box, moved, pulled, skin

HISTORY = (0.002, 0.004, 0.008, 0.007)


@pytest.fixture(params=["small", "finite"])
def measure(request: pytest.FixtureRequest) -> StrainMeasure:
    name: StrainMeasure = request.param
    return name


def solve(simulation: Simulation) -> Response:
    return BundledAdapter().solve(simulation)


def one_grain(simulation: Simulation) -> Simulation:
    mesh = replace(simulation.mesh, grain=np.zeros_like(simulation.mesh.grain))
    return replace(simulation, mesh=mesh, orientations=ORIENTATIONS[:1])


def test_patch_a_linear_motion_of_the_skin_strains_the_whole_box_alike(
    measure: StrainMeasure,
) -> None:
    """The inner nodes follow the linear field, and the force is that of one Gauss point."""
    mesh = box((2, 2, 2), (2.0, 4.0, 2.0), jitter=0.2)
    mesh = replace(mesh, grain=np.zeros_like(mesh.grain))
    material = Material(strain_measure=measure)
    gradient = np.array([[-0.4, 0.1, 0.0], [0.2, 1.0, 0.1], [0.0, -0.1, -0.3]]) * 0.004
    times = np.array([0.0, 1.0, 2.0, 3.0])

    def displacement(time: float, points: FloatArray) -> FloatArray:
        return time * points @ gradient.T

    response = solve(moved(mesh, material, skin(mesh), displacement, times, tolerance=1e-12))
    points = Points(
        measure, np.zeros(1, dtype=np.int64), local_parameters(material, 1), ORIENTATIONS[:1]
    )
    state, slips = points.initial_state(), np.zeros((1, 24))
    for row, time in enumerate(times[1:], start=1):
        expected = displacement(float(time), mesh.points)
        np.testing.assert_allclose(response.displacement[row], expected, atol=1e-12)
        H = (time * gradient @ ORIENTATIONS[0]).reshape(1, 9)
        state, slips, P, _, _ = points.update(H, state, slips, 1.0)
        stress = (P.reshape(3, 3) @ ORIENTATIONS[0].T)[1, 1]
        np.testing.assert_allclose(response.force[row], 4.0 * stress, rtol=1e-9)
    assert np.count_nonzero(slips) > 5


def test_both_ends_carry_the_same_force(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), HISTORY)
    nodes = {"S_PLUS": simulation.mesh.nodes["S_MINUS"]}
    other = replace(simulation, mesh=replace(simulation.mesh, nodes=nodes))
    force, reaction = solve(simulation).force, solve(other).force
    assert abs(force).max() > 500
    np.testing.assert_allclose(reaction, -force, atol=1e-8 * abs(force).max())


def test_two_grains_of_one_orientation_are_one_grain(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), HISTORY)
    alike = replace(simulation, orientations=ORIENTATIONS[[0, 0]])
    np.testing.assert_allclose(solve(alike).force, solve(one_grain(simulation)).force, rtol=1e-12)
    assert abs(solve(simulation).force - solve(alike).force).max() > 10


@pytest.mark.parametrize("axis", range(3))
def test_a_quarter_turn_about_a_crystal_axis_changes_nothing(
    measure: StrainMeasure, axis: int
) -> None:
    simulation = one_grain(pulled(box(), Material(strain_measure=measure), HISTORY))
    quarter = rotation_vector_matrix(0.5 * np.pi * np.eye(3)[axis])
    turned = replace(simulation, orientations=simulation.orientations @ quarter)
    np.testing.assert_allclose(solve(turned).force, solve(simulation).force, rtol=1e-8)


def test_turning_the_specimen_while_it_is_pulled_changes_no_finite_strain_force() -> None:
    """Objectivity; the turn is about Y, so that the answered component stays the same."""
    plain = pulled(box(), Material(strain_measure="finite"), HISTORY, tolerance=1e-10)
    ends = plain.motion_nodes
    start = plain.mesh.points[ends]
    motion = plain.motion.copy()
    for row, time in enumerate(plain.times):
        turn = rotation_vector_matrix(np.array([0.0, 0.003 * time, 0.0]))
        motion[row] = (start + plain.motion[row]) @ turn.T - start
    # A cut would replace a part of the turn by a straight line.
    turned = solve(replace(plain, motion=motion))
    expected = solve(plain)
    assert turned.cuts == 0
    np.testing.assert_allclose(turned.force, expected.force, rtol=1e-7)


def test_a_rigid_turn_leaves_a_finite_strain_box_without_force() -> None:
    mesh = box()

    def displacement(time: float, points: FloatArray) -> FloatArray:
        return points @ (rotation_vector_matrix(time * np.array([0.02, 0.05, -0.03])) - np.eye(3)).T

    ends = np.concatenate([mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]])
    times = np.array([0.0, 0.5, 1.0])
    response = solve(moved(mesh, Material(), ends, displacement, times))
    assert abs(response.force).max() < 1e-6
    np.testing.assert_allclose(
        response.displacement[-1], displacement(1.0, mesh.points), atol=1e-10
    )


def test_a_box_at_rest_carries_no_force_and_does_not_move(measure: StrainMeasure) -> None:
    response = solve(pulled(box(), Material(strain_measure=measure), (0.0, 0.0)))
    assert abs(response.force).max() < 1e-8  # rounding of RᵀR alone
    assert abs(response.displacement).max() < 1e-12


def test_a_free_bar_yields_at_the_load_of_schmid() -> None:
    """Elastic below τ0/μ with μ the largest Schmid factor; without hardening it stays there."""
    material = Material(strain_measure="small", c=0.0, K=1e-3, tau0=40.0)
    plain = one_grain(pulled(box(), material, (0.0002, 0.0003, 0.004, 0.006)))
    mesh, nodes = plain.mesh, plain.motion_nodes
    at = mesh.points[nodes]
    mask = np.zeros((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = True  # the ends slide freely but for one node, and one that stops the spin
    mask[np.flatnonzero((at == np.array([0, 0, 0])).all(axis=1)), :] = True
    mask[np.flatnonzero((at == np.array([2, 0, 0])).all(axis=1)), 2] = True
    response = solve(replace(plain, motion_mask=mask))
    axis = ORIENTATIONS[0].T @ [0.0, 1.0, 0.0]
    factor = abs(np.einsum("i,sij,j->s", axis, schmid_tensors(), axis)).max()
    yield_force = 4.0 * material.tau0 / factor
    elastic, before, first, second = response.force[1:]
    np.testing.assert_allclose(before, elastic * 3 / 2, rtol=1e-6)
    assert before < yield_force
    # The faces stay plane, which holds the single-slip lattice a little: hence not exactly equal.
    np.testing.assert_allclose([first, second], yield_force, rtol=1e-3)


def test_a_step_that_is_too_long_is_cut_and_ends_near_the_answer_of_many(
    measure: StrainMeasure,
) -> None:
    material = Material(strain_measure=measure)
    coarse = solve(pulled(box(), material, (0.05,)))
    fine = solve(pulled(box(), material, (0.05,), steps=100))
    assert coarse.cuts > 0
    assert fine.cuts == 0
    assert fine.steps == 100
    assert coarse.steps < 20
    np.testing.assert_allclose(coarse.force[-1], fine.force[-1], rtol=0.03)


def test_steps_grow_back_after_a_cut() -> None:
    """Five cuts make steps of 1/32: without growth there would be 32 of them."""
    response = solve(pulled(box(), Material(strain_measure="small"), (0.5,)))
    assert response.cuts >= 4
    assert response.steps < 2 ** (response.cuts - 1)


def test_a_step_without_solution_names_time_element_and_grain(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), (-150.0,))
    with pytest.raises(SolverError, match=r"no solution at t = .* s .*element \d+, grain [12]"):
        solve(simulation)


def test_progress_is_told_at_every_instant() -> None:
    told: list[Progress] = []
    simulation = pulled(box(), Material(strain_measure="small"), HISTORY)
    response = BundledAdapter().solve(simulation, progress=told.append)
    assert [p.time for p in told] == [1.0, 2.0, 3.0, 4.0]
    assert told[-1].end == 4.0
    assert told[-1].steps == response.steps == 4


def test_only_the_wanted_instants_and_nodes_are_answered() -> None:
    simulation = pulled(box(), Material(strain_measure="small"), HISTORY)
    whole = solve(simulation)
    nodes = np.array([7, 3])
    part = solve(replace(simulation, output=np.array([3, 1]), output_nodes=nodes))
    np.testing.assert_array_equal(part.force, whole.force[[3, 1]])
    np.testing.assert_array_equal(
        part.displacement, whole.displacement[np.ix_(np.array([3, 1]), nodes)]
    )


@pytest.mark.parametrize(
    ("name", "value"),
    [(name, 0.0) for name in ("C44", "K", "n", "tau0", "tau0_112", "elastic_scale")]
    + [("tau0_grain2", -1.0), ("C44_scale", -0.1)]
    + [(name, -1.0) for name in ("c", "d", "Q", "b")]
    + [(name, float("nan")) for name in ("K", "Q", "C11")],
)
def test_a_constant_out_of_its_range_is_refused_in_one_sentence(name: str, value: float) -> None:
    material = replace(Material(), **{name: value})  # type: ignore[arg-type]
    with pytest.raises(UnsupportedError, match=f"^{name} .*; expected ") as error:
        solve(pulled(box(), material, HISTORY))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("C11", "C12"), [(100e3, 120e3), (100e3, -60e3)])
def test_a_stiffness_that_is_not_positive_definite_is_refused(C11: float, C12: float) -> None:
    with pytest.raises(UnsupportedError, match="positive definite"):
        solve(pulled(box(), Material(C11=C11, C12=C12), HISTORY))

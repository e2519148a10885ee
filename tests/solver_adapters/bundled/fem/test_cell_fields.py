"""Stress, slips and lattice rotation of the cells, against statics, kinematics and Schmid's law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.bundled.fem.cell_fields import (
    cell_means,
    finite_stress,
    lattice_axes,
    rotation_between,
    small_rotation,
)
from solver_adapters.bundled.fem.element import element_of, shape_gradients
from solver_adapters.crystal import BCC, rotation_vector_matrix, schmid_tensors
from solver_adapters.interface import CellFields, Progress, Response, Simulation, UnfinishedError
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import BOXES, ORIENTATIONS, box, moved, pulled, skin

HISTORY = (0.002, 0.004, 0.008, 0.007)
FIELDS = ("stress", "slip", "accumulated_slip", "rotation")
YY = 1


def solve(simulation: Simulation) -> tuple[Response, CellFields]:
    response = BundledAdapter().solve(replace(simulation, cell_fields=True))
    assert response.cells is not None
    return response, response.cells


def volumes(simulation: Simulation) -> FloatArray:
    mesh = simulation.mesh
    _, weights = shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells))
    total: FloatArray = weights.sum(axis=1)
    return total


def free_bar(material: Material, strains: tuple[float, ...], orientation: FloatArray) -> Simulation:
    """A bar of one crystal whose ends stay plane and slide freely."""
    plain = pulled(box(), material, strains)
    mesh = replace(plain.mesh, grain=np.zeros_like(plain.mesh.grain))
    at = mesh.points[plain.motion_nodes]
    mask = np.zeros((len(at), 3), dtype=np.bool_)
    mask[:, 1] = True
    mask[np.flatnonzero((at == np.array([0, 0, 0])).all(axis=1)), :] = True
    mask[np.flatnonzero((at == np.array([2, 0, 0])).all(axis=1)), 2] = True
    return replace(plain, mesh=mesh, orientations=orientation[None], motion_mask=mask)


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_an_elastic_bar_along_a_cube_axis_carries_its_modulus_times_its_strain(
    measure: StrainMeasure,
) -> None:
    material = Material(strain_measure=measure)
    C11, C12 = material.C11, material.C12
    modulus = (C11 - C12) * (C11 + 2 * C12) / (C11 + C12)
    response, cells = solve(free_bar(material, (1e-4,), np.eye(3)))
    stress = cells.stress[-1]
    # Finite strain differs from Hooke's law by terms of the order of the strain.
    rtol = 5e-4 if measure == "finite" else 1e-9
    np.testing.assert_allclose(stress[:, YY], 1e-4 * modulus, rtol=rtol)
    np.testing.assert_allclose(np.delete(stress, YY, axis=1), 0.0, atol=1e-6)
    # Small strain does not see that the section shrinks.
    moves = response.displacement[-1] if measure == "finite" else 0.0
    area = np.prod(np.ptp(box().points + moves, axis=0)[[0, 2]])
    np.testing.assert_allclose(stress[:, YY] * area, response.force[-1], rtol=1e-9)
    assert not cells.slip.any()
    assert abs(cells.rotation).max() < 1e-12


@pytest.mark.parametrize("element", BOXES)
@pytest.mark.parametrize("varying", [False, True], ids=["grains", "lattice gradient"])
def test_the_mean_axial_stress_times_the_section_is_the_force(element: str, varying: bool) -> None:
    """Virtual work of u = Y e_Y: ∫ σ_YY dV = F L, whatever happens in between."""
    simulation = pulled(BOXES[element](jitter=0.2), Material(strain_measure="small"), HISTORY)
    if varying:
        simulation = replace(simulation, lattice_gradient=np.full((2, 3), 0.02))
    response, cells = solve(simulation)
    force = cells.stress[:, :, YY] @ volumes(simulation) / 4.0
    assert abs(response.force).max() > 500
    np.testing.assert_allclose(force, response.force, atol=1e-6 * abs(response.force).max())
    # No traction on the sides: the other mean forces balance against the clamped ends only.
    assert abs(cells.stress[-1, :, 0]).max() < abs(cells.stress[-1, :, YY]).max()


def test_a_bar_in_single_slip_carries_the_stress_of_schmid_on_the_steepest_system() -> None:
    material = Material(strain_measure="small", c=0.0, K=1e-3, tau0=40.0)
    R = ORIENTATIONS[0]
    simulation = free_bar(material, (0.0003, 0.004), R)
    _, cells = solve(simulation)
    axis = R.T @ [0.0, 1.0, 0.0]
    schmid = np.einsum("i,sij,j->s", axis, schmid_tensors(BCC), axis)
    steepest = int(np.argmax(abs(schmid)))
    # The ends stay plane, which holds the single-slip lattice a little: hence not exactly equal.
    np.testing.assert_allclose(
        cells.stress[-1, :, YY], material.tau0 / abs(schmid[steepest]), rtol=2e-3
    )
    mean = volumes(simulation) @ cells.slip[-1] / volumes(simulation).sum()
    assert int(np.argmax(abs(mean))) == steepest
    assert np.sign(mean[steepest]) == np.sign(schmid[steepest])
    # What is not elastic is slip: Σ γ m·n along the axis.
    elastic = (0.0003 * cells.stress[-1] / cells.stress[-2])[:, YY]
    np.testing.assert_allclose(cells.slip[-1] @ schmid, 0.004 - elastic, rtol=5e-3)
    np.testing.assert_allclose(cells.accumulated_slip[-1], abs(cells.slip[-1]), atol=1e-12)
    assert not cells.slip[1].any()


def test_slip_back_and_forth_accumulates_and_takes_the_signed_slip_back() -> None:
    simulation = free_bar(Material(strain_measure="small"), (0.004, -0.004, 0.004), ORIENTATIONS[0])
    _, cells = solve(simulation)
    change = np.diff(cells.slip, axis=0)
    main = int(np.argmax(abs(change).sum(axis=(0, 1))))
    turns = np.sign(change[:, :, main].T / change[0, 0, main])
    assert (turns == np.array([1.0, -1.0, 1.0])).all()
    np.testing.assert_allclose(
        cells.accumulated_slip[-1][:, main], abs(change[:, :, main]).sum(axis=0), rtol=1e-3
    )


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_a_body_that_turns_as_a_whole_turns_its_lattice(measure: StrainMeasure) -> None:
    mesh, vector = box(), np.array([0.02, 0.05, -0.03])

    def displacement(time: float, points: FloatArray) -> FloatArray:
        if measure == "small":
            return np.cross(time * vector, points)
        return points @ (rotation_vector_matrix(time * vector) - np.eye(3)).T

    material = Material(strain_measure=measure)
    times = np.array([0.0, 0.5, 1.0])
    _, cells = solve(moved(mesh, material, skin(mesh), displacement, times))
    for row, time in enumerate(times):
        expected = np.broadcast_to(time * vector, (len(mesh.cells), 3))
        np.testing.assert_allclose(cells.rotation[row], expected, atol=1e-10)
    assert abs(cells.stress).max() < 1e-4
    assert abs(cells.slip).max() < 1e-12


def test_slip_alone_leaves_the_lattice_where_it_is() -> None:
    """u = γ m (n·x) with the same slip; in finite strain Fp⁻¹ = I − γ m⊗n."""
    R, gamma = ORIENTATIONS[:1], 0.01
    shear = gamma * schmid_tensors(BCC)[4]
    slip = np.zeros((1, 24))
    slip[0, 4] = gamma
    H = (R @ shear).reshape(1, 9)
    assert abs(small_rotation(H, slip, R, schmid_tensors(BCC))).max() < 1e-17
    axes = lattice_axes(H, np.eye(3) - shear, R)
    assert abs(rotation_between(R, axes)).max() < 1e-15


def test_the_lattice_of_a_stretched_and_turned_crystal_turns_by_the_polar_rotation() -> None:
    vector = np.array([0.3, -0.2, 0.5])
    stretch = np.array([[1.02, 0.01, 0.0], [0.01, 0.97, 0.02], [0.0, 0.02, 1.0]])
    R = ORIENTATIONS[:1]
    H = (rotation_vector_matrix(vector) @ stretch @ R - R).reshape(1, 9)
    axes = lattice_axes(H, np.eye(3)[None], R)
    np.testing.assert_allclose(rotation_between(R, axes), vector[None], atol=1e-14)


def test_a_turned_stress_is_the_cauchy_stress() -> None:
    """P = J σ F⁻ᵀ (textbook definition), handed over as P·R."""
    F = np.array([[1.1, 0.2, 0.0], [0.1, 0.9, 0.3], [0.0, -0.1, 1.2]])
    sigma = np.array([[50.0, 10.0, -5.0], [10.0, 20.0, 7.0], [-5.0, 7.0, -30.0]])
    R = ORIENTATIONS[:1]
    P = np.linalg.det(F) * sigma @ np.linalg.inv(F).T
    found = finite_stress((P @ R).reshape(1, 9), ((F - np.eye(3)) @ R).reshape(1, 9), R)
    np.testing.assert_allclose(found, sigma[None], atol=1e-12)


def test_small_and_finite_strain_agree_at_small_strain() -> None:
    """A tenth of the strength yields at a tenth of the strain; what parts them is of its order."""
    strains = (1e-4, 2e-4, 1e-4)
    (_, small), (_, finite) = (
        solve(pulled(box(), Material(tau0=4.0, K=1.2, d=15000.0, strain_measure=m), strains))
        for m in ("small", "finite")
    )
    assert abs(finite.slip).max() > 5e-5
    for name in ("stress", "slip", "accumulated_slip", "rotation"):
        a, b = getattr(small, name), getattr(finite, name)
        np.testing.assert_allclose(a, b, rtol=0, atol=2e-3 * abs(b).max(), err_msg=name)


def test_means_over_cells_weigh_points_by_their_volume() -> None:
    values = np.array([[1.0], [4.0], [10.0], [20.0]])
    weights = np.array([[2.0, 1.0], [1.0, 3.0]])
    np.testing.assert_allclose(cell_means(values, weights), [[2.0], [17.5]])


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_an_eigenstrain_stresses_before_loading_and_rotation_counts_from_there(
    measure: StrainMeasure,
) -> None:
    material = Material(strain_measure=measure, eigenstrain=2e-4)
    simulation = pulled(box(), material, (0.001,))
    response, cells = solve(simulation)
    assert abs(cells.stress[0, :, YY]).max() > 5
    np.testing.assert_allclose(
        cells.stress[0, :, YY] @ volumes(simulation) / 4.0,
        response.force[0],
        atol=1e-3 * abs(cells.stress[0]).max(),
    )
    assert abs(cells.rotation[0]).max() < 1e-14
    assert abs(cells.rotation[1]).max() > 1e-5


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_asking_for_fields_changes_no_other_number(measure: StrainMeasure) -> None:
    simulation = pulled(box(), Material(strain_measure=measure), HISTORY)
    plain = BundledAdapter().solve(simulation)
    asked, _ = solve(simulation)
    assert plain.cells is None
    np.testing.assert_array_equal(plain.displacement, asked.displacement)
    np.testing.assert_array_equal(plain.force, asked.force)


def _stopped_and_whole(measure: StrainMeasure, folder: Path) -> tuple[CellFields, CellFields]:
    """Fields of a run that was stopped halfway and went on, and of one that was not."""
    simulation = pulled(box(), Material(strain_measure=measure), HISTORY)
    simulation = replace(simulation, cell_fields=True, output=np.array([0, 2, 4]))

    def stop(progress: Progress) -> None:
        if progress.time >= 2.0:
            raise KeyboardInterrupt

    adapter = BundledAdapter()
    with pytest.raises(KeyboardInterrupt):
        adapter.solve(simulation, folder, stop)
    resumed = adapter.solve(simulation, folder).cells
    _, whole = solve(simulation)
    assert resumed is not None
    assert abs(whole.slip[-1]).max() > 1e-3
    return resumed, whole


@pytest.mark.parametrize("measure", ["small", "finite"])
def test_a_run_that_was_stopped_goes_on_with_its_slips(
    measure: StrainMeasure, tmp_path: Path
) -> None:
    resumed, whole = _stopped_and_whole(measure, tmp_path)
    for name in FIELDS:
        expected = getattr(whole, name)
        np.testing.assert_allclose(
            getattr(resumed, name), expected, rtol=0, atol=1e-8 * abs(expected).max(), err_msg=name
        )


@pytest.mark.usefixtures("exact_newton")
@pytest.mark.parametrize("measure", ["small", "finite"])
def test_with_exact_linear_systems_it_goes_on_to_the_last_digit(
    measure: StrainMeasure, tmp_path: Path
) -> None:
    resumed, whole = _stopped_and_whole(measure, tmp_path)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name), err_msg=name)


def test_a_run_that_breaks_off_hands_over_the_fields_that_it_reached() -> None:
    simulation = pulled(box(), Material(strain_measure="small"), (0.002, -150.0))
    with pytest.raises(UnfinishedError) as error:
        solve(simulation)
    cells = error.value.response.cells
    assert cells is not None
    assert cells.stress.shape == (2, len(simulation.mesh.cells), 6)
    assert abs(cells.stress[1]).max() > 50

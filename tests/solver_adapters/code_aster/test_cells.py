"""Means over cells, from files that are written here as Code_Aster writes them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import medcoupling as mc
import numpy as np
import pytest

from meshes.arrays import FloatArray
from meshes.files import write_med
from solver_adapters.code_aster.cells import mean_fields
from solver_adapters.crystal import BCC, FCC, rotation_vector_matrix, schmid_tensors
from solver_adapters.interface import Simulation
from tools.code_aster_cases import small_case

WEIGHTS = [-2 / 15, 3 / 40, 3 / 40, 3 / 40, 3 / 40]
POINTS = [[0.25] * 3, [1 / 6] * 3, [1 / 6, 1 / 6, 0.5], [1 / 6, 0.5, 1 / 6], [0.5, 1 / 6, 1 / 6]]
CORNERS = [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1]
EDGES = [0.5, 0, 0, 0.5, 0.5, 0, 0, 0.5, 0, 0, 0, 0.5, 0.5, 0, 0.5, 0, 0.5, 0.5]
STRESS = ("SIXX", "SIYY", "SIZZ", "SIXY", "SIXZ", "SIYZ")


def one_instant(case: Simulation) -> Simulation:
    return replace(case, output=np.array([3]), cell_fields=True)


def written(case: Simulation, path: Path, stress: FloatArray, state: FloatArray) -> Path:
    """SIEF_ELGA (n_cells, 5, 6) and VARI_ELGA (n_cells, 5, n) at the last instant."""
    write_med(case.mesh, path)
    mesh = mc.MEDFileUMesh(str(path)).getMeshAtLevel(0)
    names = {"SIEF_ELGA": STRESS, "VARI_ELGA": [f"V{i + 1}" for i in range(state.shape[-1])]}
    for (name, components), values in zip(names.items(), (stress, state), strict=True):
        field = mc.MEDCouplingFieldDouble(mc.ON_GAUSS_PT, mc.ONE_TIME)
        field.setName(f"U_______{name}")
        field.setMesh(mesh)
        field.setTime(float(case.times[-1]), 3, 3)
        positions = [coordinate for point in POINTS for coordinate in point]
        field.setGaussLocalizationOnType(mc.NORM_TETRA10, CORNERS + EDGES, positions, WEIGHTS)
        array = mc.DataArrayDouble(np.ascontiguousarray(values.reshape(-1, values.shape[-1])))
        array.setInfoOnComponents(list(components))
        field.setArray(array)
        file = mc.MEDFileField1TS()
        file.setFieldNoProfileSBT(field)
        file.write(str(path), 0)
    return path


@pytest.mark.parametrize("ratio", [1.0, 1.25])
def test_means_weigh_the_gauss_points_and_order_the_systems(tmp_path: Path, ratio: float) -> None:
    case = one_instant(small_case(tau0_112=ratio))
    generator = np.random.default_rng(7)
    n = len(case.mesh.cells)
    stress, state = generator.normal(size=(n, 5, 6)), generator.normal(size=(n, 5, 105))
    path = written(case, tmp_path / "cells.rmed", stress, state)
    motion = np.zeros((1, len(case.mesh.points), 3))
    fields = mean_fields(case, motion, path)
    share = np.array(WEIGHTS) * 6
    mean = np.einsum("g,cgk->ck", share, stress)
    np.testing.assert_allclose(fields.stress[0], mean[:, [0, 1, 2, 5, 4, 3]], atol=1e-13)
    slips = np.einsum("g,cgk->ck", share, state)
    # In CUBIQUE1 the first system of BCC24 is the last of {110}, the second (turned) before it.
    place, other, sense = (0, 1, 1.0) if ratio == 1.0 else (11, 10, -1.0)
    np.testing.assert_allclose(fields.slip[0, :, 0], slips[:, 6 + 3 * place + 1], atol=1e-13)
    np.testing.assert_allclose(fields.slip[0, :, 1], sense * slips[:, 6 + 3 * other + 1])
    np.testing.assert_allclose(fields.accumulated_slip[0, :, 1], slips[:, 6 + 3 * other + 2])
    np.testing.assert_allclose(fields.slip[0, :, 23], slips[:, 6 + 3 * 23 + 1])


def test_in_small_strain_the_lattice_turns_by_what_slip_leaves_of_the_spin(tmp_path: Path) -> None:
    """A motion that is a rotation w plus the displacement gradient of slip on one system."""
    case = one_instant(small_case())
    n = len(case.mesh.cells)
    w, amount, system = np.array([1e-3, -2e-3, 3e-3]), 5e-3, 4
    spin = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    R = case.orientations[0]
    case = replace(case, orientations=np.stack([R, R]))
    gradient = spin + amount * R @ schmid_tensors(BCC)[system] @ R.T
    state = np.zeros((n, 5, 105))
    state[..., 6 + 3 * system + 1] = amount
    path = written(case, tmp_path / "cells.rmed", np.zeros((n, 5, 6)), state)
    fields = mean_fields(case, (case.mesh.points @ gradient.T)[None], path)
    np.testing.assert_allclose(fields.rotation[0], np.tile(w, (n, 1)), atol=1e-14)


def test_slips_of_fcc_are_those_of_twelve_systems_and_turn_its_lattice(tmp_path: Path) -> None:
    case = one_instant(small_case(slip_systems=FCC))
    n, amount, system = len(case.mesh.cells), 5e-3, 7
    R = case.orientations[0]
    case = replace(case, orientations=np.stack([R, R]))
    gradient = amount * R @ schmid_tensors(FCC)[system] @ R.T
    state = np.zeros((n, 5, 57))
    state[..., 6 + 3 * system + 1], state[..., 6 + 3 * system + 2] = amount, 2 * amount
    path = written(case, tmp_path / "cells.rmed", np.zeros((n, 5, 6)), state)
    fields = mean_fields(case, (case.mesh.points @ gradient.T)[None], path)
    slip = np.zeros(24)
    slip[system] = amount
    np.testing.assert_allclose(fields.slip[0], np.tile(slip, (n, 1)), atol=1e-15)
    np.testing.assert_allclose(fields.accumulated_slip[0], np.tile(2 * slip, (n, 1)), atol=1e-15)
    np.testing.assert_allclose(fields.rotation[0], 0.0, atol=1e-14)


def test_in_finite_strain_the_lattice_turns_by_the_rotation_in_Fe(tmp_path: Path) -> None:
    case = one_instant(small_case())
    case = replace(case, material=replace(case.material, strain_measure="finite"))
    n = len(case.mesh.cells)
    w = np.array([0.1, -0.2, 0.3])
    stretch = np.eye(3) + 1e-3 * np.array([[2.0, 1.0, 0.0], [1.0, -1.0, 0.5], [0.0, 0.5, 0.3]])
    state = np.zeros((n, 5, 123))
    # V112–120: Fe − I, column by column.
    state[..., 111:120] = (rotation_vector_matrix(w) @ stretch - np.eye(3)).T.ravel()
    path = written(case, tmp_path / "cells.rmed", np.zeros((n, 5, 6)), state)
    fields = mean_fields(case, np.zeros((1, len(case.mesh.points), 3)), path)
    np.testing.assert_allclose(fields.rotation[0], np.tile(w, (n, 1)), atol=1e-12)

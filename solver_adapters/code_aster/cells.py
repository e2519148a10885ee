"""Means over the cells of what Code_Aster writes at their Gauss points.

VARI_ELGA of MONOCRISTAL: V1–6 plastic strain (XX, YY, ZZ, XY, XZ, YZ, shears times √2), then α, γ
and p of each system in turn; in finite strain also V112–120 = Fe − I, column by column, in the
specimen frame, of 24 systems.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from meshes.arrays import FloatArray, IntArray
from meshes.tet10 import centre_gradients
from solver_adapters.code_aster.law import system_order
from solver_adapters.code_aster.rmed import Field, ResultFile
from solver_adapters.crystal import SYSTEM_COUNTS, schmid_tensors
from solver_adapters.interface import CellFields, Simulation

_STRESS = ("SIXX", "SIYY", "SIZZ", "SIYZ", "SIXZ", "SIXY")
_ELASTIC_PART = tuple(f"V{number}" for number in range(112, 121))


def mean_fields(simulation: Simulation, motion: FloatArray, path: Path) -> CellFields:
    """Return the fields of the cells at the output instants.

    Args:
        simulation: what was simulated.
        motion: displacement of all nodes [µm], shape (n_output, n_nodes, 3).
        path: file with SIEF_ELGA and VARI_ELGA.

    Raises:
        ResultFileError: it is missing, truncated, empty or not what it should be.
    """
    file = ResultFile(path)
    file.require_mesh(simulation.mesh)
    instants = simulation.times[simulation.output]
    state = file.at_gauss_points("VARI_ELGA", instants)
    places, senses = system_order(simulation.material)
    slip = _of_all(cell_means(state, *_variables(places, 2)) * senses)
    if simulation.material.strain_measure == "finite":
        rotation = _finite_rotation(state)
    else:
        rotation = small_rotation(simulation, motion, slip)
    return CellFields(
        stress=cell_means(file.at_gauss_points("SIEF_ELGA", instants), *_STRESS),
        slip=slip,
        accumulated_slip=_of_all(cell_means(state, *_variables(places, 3))),
        rotation=rotation,
    )


def cell_means(field: Field, *names: str) -> FloatArray:
    """Means of components over cells with straight edges, shape (n_instants, n_cells, k)."""
    means: FloatArray = np.average(field.pick(*names), axis=2, weights=field.weights)
    return means


def small_rotation(simulation: Simulation, motion: FloatArray, slip: FloatArray) -> FloatArray:
    """Rotation vector of the lattice: what slip leaves of the displacement gradient's spin.

    Args:
        simulation: what was simulated.
        motion: displacement of all nodes [µm], shape (n_output, n_nodes, 3).
        slip: mean slip of the cells, shape (n_output, n_cells, 24).

    Returns:
        rotation vectors [rad], specimen frame, shape (n_output, n_cells, 3).
    """
    mesh = simulation.mesh
    gradient = np.einsum(
        "tcai,caj->tcij", motion[:, mesh.cells], centre_gradients(mesh.points, mesh.cells)
    )
    R = simulation.orientations
    schmid = np.einsum("gij,sjk,glk->gsil", R, schmid_tensors(simulation.material.slip_systems), R)
    elastic = gradient - np.einsum("tcs,csij->tcij", slip, schmid[mesh.grain])
    after, before = [2, 0, 1], [1, 2, 0]
    return np.asarray(0.5 * (elastic[..., after, before] - elastic[..., before, after]))


def _finite_rotation(state: Field) -> FloatArray:
    """Means of the rotation vectors of the polar rotation of Fe [rad]."""
    columns = state.pick(*_ELASTIC_PART)
    elastic = np.eye(3) + np.swapaxes(columns.reshape(*columns.shape[:-1], 3, 3), -1, -2)
    left, _, right = np.linalg.svd(elastic)
    turned = Rotation.from_matrix((left @ right).reshape(-1, 3, 3)).as_rotvec()
    vectors = turned.reshape(*columns.shape[:-1], 3)
    return np.asarray(np.average(vectors, axis=2, weights=state.weights))


def _variables(places: IntArray, which: int) -> list[str]:
    """Names of α (1), γ (2) or p (3) of the systems in the order of `crystal`."""
    return [f"V{6 + 3 * place + which}" for place in places]


def _of_all(values: FloatArray) -> FloatArray:
    """Return values of the systems (…, n) with zeros for those behind them, shape (…, 24)."""
    beyond = SYSTEM_COUNTS[0] - values.shape[-1]
    return np.pad(values, [(0, 0)] * (values.ndim - 1) + [(0, beyond)])

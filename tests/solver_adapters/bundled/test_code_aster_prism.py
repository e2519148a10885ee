"""The whole solver against Code_Aster on a prism of 669 tetrahedra, at the same time steps."""

from __future__ import annotations

from pathlib import Path

import medcoupling as mc
import numpy as np

from meshes.prism_mesh import PrismMesh
from meshes.tet10 import MIRRORED
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import FloatArray, Simulation
from solver_adapters.material import Material
from tests.solver_adapters.boxes import ORIENTATIONS

DATA = Path(__file__).parents[2] / "data"
CORNERS = (0.0, 10.0, 14.0, 28.0)


def _mesh() -> PrismMesh:
    file = mc.MEDFileUMesh(str(DATA / "meshes" / "code_aster_prism.med"))
    points = file.getCoords().toNumPyArray().copy()
    table = file.getMeshAtLevel(0).getNodalConnectivity().toNumPyArray().reshape(-1, 11)
    grain = np.zeros(len(table), dtype=np.int64)
    grain[file.getGroupArr(0, "GRAIN2").toNumPyArray()] = 1
    ends = {
        "S_MINUS": np.flatnonzero(abs(points[:, 1]) < 1e-6),
        "S_PLUS": np.flatnonzero(abs(points[:, 1] - 12) < 1e-6),
    }
    return PrismMesh(points, table[:, 1:][:, MIRRORED].astype(np.int64), grain, {}, ends)


def _simulation(times: FloatArray) -> Simulation:
    """The lower end clamped; the upper one bent, pulled, unloaded and pulled again."""
    mesh = _mesh()
    low, high = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    motion = np.zeros((len(times), len(low) + len(high), 3))
    strain = np.interp(times, CORNERS, [0, 0.01, 0.006, 0.02])
    depth = mesh.points[high, 2]
    motion[:, len(low) :, 1] = 12 * strain[:, None] * (1 + 0.01 * (depth + 1.1547))
    motion[:, len(low) :, 2] = np.interp(times, CORNERS, [0, 0.01, 0.006, 0.03])[:, None]
    nodes = np.concatenate([low, high])
    return Simulation(
        mesh=mesh,
        material=Material(strain_measure="small"),
        orientations=ORIENTATIONS,
        times=times,
        motion_nodes=nodes,
        motion_mask=np.ones((len(nodes), 3), dtype=np.bool_),
        motion=motion,
        output=np.arange(len(times)),
        output_nodes=np.arange(0),
        integration="backward_euler",
    )


# Code_Aster integrates this element with five points, prismid with four: hence the 0.05 %.
def test_a_load_cycle_of_the_prism_agrees_with_code_aster() -> None:
    with np.load(DATA / "solver" / "code_aster_prism.npz") as data:
        times, (instants, reference) = data["steps"], data["force"].T
    response = BundledAdapter().solve(_simulation(times))
    assert response.cuts == 0
    force = response.force[np.searchsorted(times, instants - 1e-6)]
    difference = abs(force - reference) / abs(reference).max()
    assert difference[:5].max() < 1e-4
    assert difference.max() < 6e-4

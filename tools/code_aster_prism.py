"""The two-grain prism that Code_Aster 15.2 solved: its answer, and the same for prismid."""

from __future__ import annotations

import gzip
import tempfile
from dataclasses import replace
from pathlib import Path

import medcoupling as mc
import numpy as np

from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from meshes.tet10 import MIRRORED
from solver_adapters.code_aster.deck import FORCES, LISTING, NODES
from solver_adapters.code_aster.result import read
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Response, Simulation
from solver_adapters.material import Material

DATA = Path(__file__).parents[1] / "tests" / "data"
CORNERS = (0.0, 10.0, 14.0, 28.0)
"""Instants at which the loading turns [s]."""
KEPT = (0.0, 50.0 / 14.0, 10.0, 14.0, 28.0)
"""Instants at which all displacements are stored [s]."""


def read_mesh() -> PrismMesh:
    """Return the mesh on which Code_Aster ran, 669 tetrahedra [µm]."""
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


def simulation(times: FloatArray) -> Simulation:
    """Return the lower end clamped; the upper one bent, pulled, unloaded and pulled again.

    Args:
        times: instants of the answer [s], the first one 0, with the corners among them.
    """
    mesh = read_mesh()
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
        orientations=np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150)]),
        times=times,
        motion_nodes=nodes,
        motion_mask=np.ones((len(nodes), 3), dtype=np.bool_),
        motion=motion,
        output=np.arange(len(times)),
        output_nodes=np.arange(0),
        integration="backward_euler",
    )


def reference() -> tuple[Simulation, Response]:
    """Return Code_Aster's answer at the instants `KEPT`, and the simulation at its 45 steps.

    Its displacements are those of all nodes.
    """
    ends, _ = forces()
    same = simulation(ends)
    wanted = replace(
        same,
        output=np.array([abs(ends - instant).argmin() for instant in KEPT]),
        output_nodes=np.arange(len(same.mesh.points)),
    )
    stored = {NODES: "prism.rmed", FORCES: "prism_forces.csv", LISTING: "logs/prism_done.log"}
    with tempfile.TemporaryDirectory() as folder:
        for name, packed in stored.items():
            content = (DATA / "solver" / "code_aster" / f"{packed}.gz").read_bytes()
            (Path(folder) / name).write_bytes(gzip.decompress(content))
        response = read(wanted, Path(folder))
    return wanted, replace(response, steps=len(ends) - 1, ends=ends[1:])


def forces() -> tuple[FloatArray, FloatArray]:
    """Its time steps [s] with the start, shape (46,), and rows of instant [s] and force [µN]."""
    with np.load(DATA / "solver" / "code_aster_prism.npz") as data:
        return data["steps"], data["force"]

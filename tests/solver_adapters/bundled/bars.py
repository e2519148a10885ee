"""Specimens in uniform tension."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from meshes.prism import CellKind, PrismGeometry, generate
from meshes.prism_mesh import PrismMesh
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Simulation
from solver_adapters.material import Material

TIMES = np.arange(5.0)
STRAINS = np.array([0.0, 1e-3, 3e-3, 6e-3, 4e-3])
ROTATION = bunge_matrix(281, 8, 47)


def bar(geometry: PrismGeometry, kind: CellKind, material: Material) -> Simulation:
    """Return a bar of one orientation, on cells of 2 µm."""
    return flat_ended(generate(geometry, 2.0, kind), ROTATION[None], material)


def flat_ended(mesh: PrismMesh, orientations: FloatArray, material: Material) -> Simulation:
    """Flat ends that move along Y; three components pin the rest of a rigid motion."""
    low, high = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    nodes = np.concatenate([low, high])
    mask = np.zeros((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = True
    x, z = mesh.points[low][:, [0, 2]].T
    bottom = z < z.min() + 1e-9
    mask[np.flatnonzero(bottom & (x == x[bottom].min())), ::2] = True
    # The second one stops the turn about Y.
    mask[np.flatnonzero((z == z.max()) & (x == x.min())), 0] = True
    motion = np.zeros((len(TIMES), len(nodes), 3))
    motion[:, len(low) :, 1] = mesh.points[:, 1].max() * STRAINS[:, None]
    return Simulation(
        mesh=mesh,
        material=material,
        orientations=orientations,
        times=TIMES,
        motion_nodes=nodes,
        motion_mask=mask,
        motion=motion,
        output=np.arange(len(TIMES)),
        output_nodes=mesh.nodes["S_PLUS"],
        tolerance=1e-9,
        integration="backward_euler",
    )

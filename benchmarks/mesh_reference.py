"""Converged predictions of the face and of the load, stored, and how they are made anew.

A reference is the mean of two predictions of different formulations on the smallest cells that can
be had. How far they are apart says how well it is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.forward.model import ForwardModel
from meshes.arrays import FloatArray, IntArray
from meshes.surface import SurfaceMesh, interpolation, trace

FOLDER = Path(__file__).parent / "references"


@dataclass(frozen=True, eq=False)
class Reference:
    """Two predictions on one mesh, T images.

    Attributes:
        face: the measured face of its mesh, n nodes.
        motion: of the nodes [µm], (2, T, n, 3).
        load: [µN], (2, T).
        n_cells: cells of the mesh.
    """

    face: SurfaceMesh
    motion: FloatArray
    load: FloatArray
    n_cells: int

    def at(self, pixels: FloatArray) -> FloatArray:
        """Both motions at pixels (n_pix, 2), (2, T, n_pix, 3) [µm]."""
        operator, inside = interpolation(self.face, pixels)
        assert inside.all()
        both, T, n, _ = self.motion.shape
        flat = operator @ self.motion.transpose(2, 0, 1, 3).reshape(n, -1)
        return np.ascontiguousarray(flat.reshape(-1, both, T, 3).transpose(1, 2, 0, 3))


def made(models: tuple[ForwardModel, ForwardModel], values: dict[str, float]) -> Reference:
    """Simulate both models, which share their mesh."""
    mesh = models[0].microstructure.mesh
    responses = [model.adapter.solve(model.simulation(values)) for model in models]
    return Reference(
        trace(mesh),
        np.array([response.displacement for response in responses]),
        np.array([response.force for response in responses]),
        len(mesh.cells),
    )


def write(reference: Reference, name: str) -> None:
    """Store a reference."""
    FOLDER.mkdir(exist_ok=True)
    np.savez_compressed(
        FOLDER / f"{name}.npz",
        points=reference.face.points,
        cells=reference.face.cells.astype(np.int32),
        motion=reference.motion.astype(np.float32),
        load=reference.load,
        n_cells=reference.n_cells,
    )


def read(name: str) -> Reference:
    """Return a stored reference."""
    with np.load(FOLDER / f"{name}.npz") as stored:
        cells: IntArray = stored["cells"].astype(np.int64)
        face = SurfaceMesh(stored["points"], cells, np.arange(len(stored["points"])))
        return Reference(
            face, stored["motion"].astype(np.float64), stored["load"], int(stored["n_cells"])
        )

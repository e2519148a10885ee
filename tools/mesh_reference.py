"""Converged predictions of the face and of the load, stored, and how they are made anew.

A reference is the mean of two predictions on different kinds of cells, each extrapolated from two
sizes of small cells to cells of no size. How far they are apart says how well it is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from driver.forward.model import ForwardModel
from meshes.arrays import FloatArray, IntArray
from meshes.surface import SurfaceMesh, interpolation, trace

FOLDER = Path(__file__).parent / "references"
ORDER = 1.5
"""Power of the size by which predictions on cells below 0.7 µm are extrapolated.

By it both kinds of cells agree best in the load (benchmarks/numerics.md).

A judge has a constant of its own: that of the program may change.
"""
_INSET = 1e-6  # µm, by which points of an edge are drawn onto the face


@dataclass(frozen=True, eq=False)
class Reference:
    """Predictions on the face of one mesh, m of them, T images.

    Attributes:
        face: the measured face of the smallest cells of the first prediction, n nodes.
        motion: of the nodes [µm], (m, T, n, 3).
        load: [µN], (m, T).
        n_cells: cells of that mesh.
    """

    face: SurfaceMesh
    motion: FloatArray
    load: FloatArray
    n_cells: int

    def at(self, pixels: FloatArray) -> FloatArray:
        """All motions at pixels (n_pix, 2), (m, T, n_pix, 3) [µm]."""
        operator, inside = interpolation(self.face, pixels)
        assert inside.all()
        both, T, n, _ = self.motion.shape
        flat = operator @ self.motion.transpose(2, 0, 1, 3).reshape(n, -1)
        return np.ascontiguousarray(flat.reshape(-1, both, T, 3).transpose(1, 2, 0, 3))


def on_face(face: SurfaceMesh, motion: FloatArray, points: FloatArray) -> FloatArray:
    """Return the motion of a face at points of it, which its edge takes in.

    Args:
        face: n nodes.
        motion: of its nodes [µm], shape (T, n, 3).
        points: shape (m, 2) [µm]; those within `_INSET` of the edge are drawn onto the face.

    Returns:
        shape (T, m, 3) [µm].

    Raises:
        ValueError: a point lies beyond the face.
    """
    low, high = face.points.min(axis=0) + _INSET, face.points.max(axis=0) - _INSET
    drawn = np.clip(points, low, high)
    operator, inside = interpolation(face, drawn)
    if not inside.all() or np.abs(drawn - points).max() > 2 * _INSET:
        raise ValueError("points of a face: found one beyond it, expected all on it")
    T, n, _ = motion.shape
    flat = operator @ motion.transpose(1, 0, 2).reshape(n, -1)
    return np.ascontiguousarray(flat.reshape(-1, T, 3).transpose(1, 0, 2))


def extrapolated(coarser: FloatArray, finer: FloatArray, ratio: float) -> FloatArray:
    """Return what two predictions say of cells of no size (Richardson's extrapolation).

    Args:
        coarser: the prediction on the larger cells.
        finer: that on the smaller ones.
        ratio: of the size of the smaller cells to that of the larger ones.
    """
    fallen: float = ratio**ORDER
    return finer + fallen / (1.0 - fallen) * (finer - coarser)


def made(pairs: Sequence[tuple[ForwardModel, ForwardModel]], values: dict[str, float]) -> Reference:
    """Simulate two pairs of models, each of one kind of cells, the larger ones first.

    All motions are read at the nodes of the smaller cells of the first pair.
    """
    face = trace(pairs[0][1].microstructure.mesh)
    motions, loads = [], []
    for pair in pairs:
        responses = [model.adapter.solve(model.simulation(values)) for model in pair]
        meshes = [model.microstructure.mesh for model in pair]
        ratio = (len(meshes[0].cells) / len(meshes[1].cells)) ** (1.0 / 3.0)
        coarser, finer = (
            on_face(trace(mesh), response.displacement, face.points)
            for mesh, response in zip(meshes, responses, strict=True)
        )
        motions.append(extrapolated(coarser, finer, ratio))
        loads.append(extrapolated(responses[0].force, responses[1].force, ratio))
    n_cells = len(pairs[0][1].microstructure.mesh.cells)
    return Reference(face, np.array(motions), np.array(loads), n_cells)


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

"""Steps of height where slip is not spread evenly but bound to planes.

A finite element gives the mean of the slip. Where system s slips by γ on planes a distance h
apart, the material between two planes moves as a block: with ξ = n·x the motion is γ m times
the staircase h·stair(ξ/h) instead of γ m ξ. The steps of height are their difference,

    δw = Σ_s γ_s m_Z h saw(ξ/h),    saw(t) = Σ_k sin(2πkt)/(πk) exp(−2 (πkσ|n_XY|/h)²),

a saw-tooth of zero mean along the traces of the planes, rounded over the resolution σ of the
instrument. The motion of the blocks in the plane of the face is left as the elements have it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.virtual.microscope.face_motion import Face
from meshes.arrays import FloatArray, IntArray
from meshes.cells import outer_faces
from meshes.prism_mesh import PrismMesh
from solver_adapters.crystal import SystemTable, slip_systems

_NEGLIGIBLE = 1e-6  # µm of height; and share of a wave


@dataclass(frozen=True, eq=False)
class SlipSteps:
    """Where the planes are, and how much slips on them, k combinations of grain and system.

    Attributes:
        face: the face.
        grain: grain of each cell of the face, shape (n_cells,).
        slip: signed slip at the corners of the cells for each image,
            (T, n_cells, 3 or 4, n_systems).
        normals: X, Y of the plane normals in the specimen frame, shape (n_grains, n_systems, 2).
        rise: Z of the slip directions, shape (n_grains, n_systems).
        phases: where the planes lie within their distance, shape (n_grains, n_systems).
        spacing: distance of two planes [µm].
        resolution: standard deviation over which a step is rounded along the face [µm].
    """

    face: Face
    grain: IntArray
    slip: FloatArray
    normals: FloatArray
    rise: FloatArray
    phases: FloatArray
    spacing: float
    resolution: float

    def __call__(self, image: int, x: FloatArray, y: FloatArray) -> FloatArray:
        """Heights of the steps of an image [µm] at material points of any shape."""
        cell, at, _ = self.face.locate(x.ravel(), y.ravel())
        slip = np.einsum("nc,ncs->ns", self.face.corner_shares(at), self.slip[image, cell])
        grain = self.grain[cell]
        height = np.zeros(x.size)
        for g, s in np.ndindex(self.rise.shape):
            inside = np.flatnonzero(grain == g)
            rise = slip[inside, s] * self.rise[g, s] * self.spacing
            across = float(np.linalg.norm(self.normals[g, s]))
            if not inside.size or np.abs(rise).max() < _NEGLIGIBLE or across < _NEGLIGIBLE:
                continue
            places = np.column_stack([x.ravel()[inside], y.ravel()[inside]])
            turns = places @ self.normals[g, s] / self.spacing + self.phases[g, s]
            blur = np.pi * self.resolution * across / self.spacing
            waves = int(np.ceil(np.sqrt(-0.5 * np.log(_NEGLIGIBLE)) / blur))
            k = np.arange(1, waves + 1)
            weights = np.exp(-2 * (k * blur) ** 2) / (np.pi * k)
            height[inside] += rise * (np.sin(2 * np.pi * np.outer(turns, k)) @ weights)
        return height.reshape(x.shape)


def slip_steps(
    mesh: PrismMesh,
    face: Face,
    slip: FloatArray,
    orientations: FloatArray,
    systems: SystemTable,
    spacing: float,
    resolution: float,
    rng: np.random.Generator,
) -> SlipSteps:
    """Return the steps on a face from the slip in the cells below it.

    Args:
        mesh: the prism.
        face: its face TOP.
        slip: signed slip of each cell of the prism, shape (T, n_cells, n_systems).
        orientations: crystal → specimen rotation of each grain, shape (n_grains, 3, 3).
        systems: the slip systems.
        spacing: distance of two slip planes [µm].
        resolution: standard deviation over which a step is rounded [µm].
        rng: source of the positions of the planes.
    """
    below = cells_below(mesh, face)
    grain = mesh.grain[below]
    corners = face.plane.corners
    at_corners = np.zeros((len(slip), *corners.shape, slip.shape[2]))
    for g in range(mesh.n_grains):
        own = np.flatnonzero(grain == g)
        # The mean over the cells of the grain around each node: slip jumps between grains only.
        total = np.zeros((len(face.mesh.points), len(slip), slip.shape[2]))
        np.add.at(total, corners[own], np.swapaxes(slip[:, below[own]], 0, 1)[:, None])
        count = np.bincount(corners[own].ravel(), minlength=len(total))
        mean = total / np.maximum(count, 1)[:, None, None]
        at_corners[:, own] = np.moveaxis(mean[corners[own]], 2, 0)
    directions, normals = slip_systems(systems)
    return SlipSteps(
        face=face,
        grain=grain,
        slip=at_corners,
        normals=np.einsum("gij,sj->gsi", orientations, normals)[..., :2],
        rise=np.einsum("gij,sj->gsi", orientations, directions)[..., 2],
        phases=rng.uniform(0, 1, (len(orientations), len(normals))),
        spacing=spacing,
        resolution=resolution,
    )


def cells_below(mesh: PrismMesh, face: Face) -> IntArray:
    """Return the cell of the prism that carries each cell of its face, shape (n_face_cells,)."""
    outer, owner = outer_faces(mesh.cells)
    corners = face.mesh.nodes[face.plane.corners]
    sides = np.sort(outer[:, : corners.shape[1]], axis=1)
    carriers = {tuple(side): cell for side, cell in zip(sides, owner, strict=True)}
    return np.array([carriers[tuple(side)] for side in np.sort(corners, axis=1)], dtype=np.int64)

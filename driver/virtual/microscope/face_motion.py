"""Motion of a face as its quadratic finite elements have it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from matplotlib.tri import Triangulation

from meshes.arrays import FloatArray, IntArray
from meshes.surface import SurfaceMesh

_INSIDE = 1 - 1e-9  # points on the edge count as on the face
# Derivatives of the barycentric coordinates (a, b, c) along b and c.
_BARYCENTRIC = np.array([[-1.0, -1.0], [1.0, 0.0], [0.0, 1.0]])


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangular face of tri6 elements with straight sides.

    Attributes:
        mesh: the elements.

    Raises:
        ValueError: elements of another kind, as the face of a mesh of wedges has.
    """

    mesh: SurfaceMesh

    def __post_init__(self) -> None:
        """Refuse what `locate` cannot place points in."""
        if self.mesh.cells.shape[1] != 6:
            raise ValueError("the face is made of quad8; a tri6 face, of a tet10 mesh, is expected")

    @cached_property
    def bounds(self) -> FloatArray:
        """Least and largest X, Y [µm], shape (2, 2)."""
        return np.array([self.mesh.points.min(axis=0), self.mesh.points.max(axis=0)])

    @cached_property
    def _triangles(self) -> Triangulation:
        points, corners = self.mesh.points, self.mesh.cells[:, :3]
        return Triangulation(points[:, 0], points[:, 1], corners)

    @cached_property
    def _inverse(self) -> FloatArray:
        """Derivatives of (b, c) along X and Y in each cell [1/µm], shape (n_cells, 2, 2)."""
        corners = self.mesh.points[self.mesh.cells[:, :3]]
        sides: FloatArray = np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2)
        return np.asarray(np.linalg.inv(sides))

    def locate(self, x: FloatArray, y: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Return the cell at each point, or at the point of the edge that is next to it.

        Args:
            x: X [µm], shape (n,).
            y: Y [µm], shape (n,).

        Returns:
            cell (n,); barycentric coordinates (n, 3); their derivatives along X and Y [1/µm],
            zero in a direction in which the point lies beyond the edge, (n, 3, 2).
        """
        middle, half = self.bounds.mean(axis=0), _INSIDE * np.ptp(self.bounds, axis=0) / 2
        given = np.column_stack([x, y])
        places = np.clip(given, middle - half, middle + half)
        cell = np.asarray(self._triangles.get_trifinder()(*places.T), dtype=np.int64)
        inverse = self._inverse[cell]
        origin = self.mesh.points[self.mesh.cells[cell, 0]]
        bc = np.einsum("nij,nj->ni", inverse, places - origin)
        slopes = np.einsum("ab,nbj->naj", _BARYCENTRIC, inverse)
        slopes *= (places == given)[:, None, :]
        return cell, np.column_stack([1.0 - bc.sum(axis=1), bc]), slopes


@dataclass(frozen=True, eq=False)
class NodalMotion:
    """The motion that nodal values of a face give, carried on unchanged beyond its edges.

    Attributes:
        face: the face, n nodes.
        nodal: motion of the nodes [µm], shape (n, 3).
    """

    face: Face
    nodal: FloatArray

    def __call__(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u, v, w (n, 3) [µm] and their slopes (n, 3, 2), as `inversion.Motion` has it."""
        cell, abc, slopes = self.face.locate(x, y)
        values = self.nodal[self.face.mesh.cells[cell]]
        after = np.roll(abc, -1, axis=1)
        shapes = np.concatenate([abc * (2 * abc - 1), 4 * abc * after], axis=1)
        change = np.concatenate(
            [
                (4 * abc - 1)[..., None] * slopes,
                4 * (abc[..., None] * np.roll(slopes, -1, axis=1) + after[..., None] * slopes),
            ],
            axis=1,
        )
        return (
            np.einsum("nk,nkd->nd", shapes, values),
            np.einsum("nkj,nkd->ndj", change, values),
        )

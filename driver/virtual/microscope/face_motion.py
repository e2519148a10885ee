"""Motion of a face as its quadratic finite elements have it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.plane_cells import CELLS
from meshes.plane_mesh import PlaneMesh
from meshes.surface import SurfaceMesh

_INSIDE = 1 - 1e-9  # points on the edge count as on the face


@dataclass(frozen=True, eq=False)
class Face:
    """A rectangular face of tri6 or quad8 elements.

    Attributes:
        mesh: the elements.
    """

    mesh: SurfaceMesh

    @cached_property
    def bounds(self) -> FloatArray:
        """Least and largest X, Y [µm], shape (2, 2)."""
        return np.array([self.mesh.points.min(axis=0), self.mesh.points.max(axis=0)])

    @cached_property
    def plane(self) -> PlaneMesh:
        """The elements as a plane mesh."""
        return self.mesh.plane

    def locate(self, x: FloatArray, y: FloatArray) -> tuple[IntArray, FloatArray, BoolArray]:
        """Return the cell at each point, or at the point of the edge that is next to it.

        Args:
            x: X [µm], shape (n,).
            y: Y [µm], shape (n,).

        Returns:
            cell (n,); reference coordinates in it (n, 2); whether the point lies within the edges
            along X and along Y (n, 2).
        """
        middle, half = self.bounds.mean(axis=0), _INSIDE * np.ptp(self.bounds, axis=0) / 2
        given = np.column_stack([x, y])
        places = np.clip(given, middle - half, middle + half)
        cell, at = self.plane.locate(places)
        return cell, at, places == given

    def corner_shares(self, at: FloatArray) -> FloatArray:
        """Return linear shape functions of the corners at reference coordinates (n, 2), (n, k)."""
        return CELLS["tri3" if self.plane.kind == "tri6" else "quad4"].shape(at)


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
        cell, at, within = self.face.locate(x, y)
        plane = self.face.plane
        nodes = plane.cells[cell]
        values = self.nodal[nodes]
        gradients = plane.cell.gradient(at)
        # Derivatives of X, Y and of the motion along the reference coordinates.
        of_place = np.einsum("nki,nkr->nir", plane.points[nodes], gradients)
        of_motion = np.einsum("nkd,nkr->ndr", values, gradients)
        slopes = of_motion @ np.linalg.inv(of_place) * within[:, None]
        return np.einsum("nk,nkd->nd", plane.cell.shape(at), values), slopes

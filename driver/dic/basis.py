"""Scalar finite-element bases on the measured surface."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.sparse import csr_array

from driver.dic.kernels import grid_places, motion_of
from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.plane_mesh import PlaneMesh


@dataclass(frozen=True, eq=False)
class Basis:
    """The shape functions of a plane mesh, and the pixels in its cells.

    Attributes:
        mesh: tri3, tri6, quad4 or quad8.
        cell: cell of each pixel of the region of interest, shape (n_pixels,).
        shape: functions of that cell at the pixel, shape (n_pixels, nodes of a cell).
    """

    mesh: PlaneMesh
    cell: IntArray
    shape: FloatArray

    @property
    def nodes(self) -> FloatArray:
        """Position of the node of each function [µm], shape (n_functions, 2)."""
        return self.mesh.points

    @property
    def element_size(self) -> float:
        """Side of a square as large as the mean cell [µm]."""
        return self.mesh.size

    @cached_property
    def values(self) -> csr_array:
        """Each function at each pixel, shape (n_pixels, n_functions)."""
        return _matrix(self.mesh, self.cell, self.shape)

    def at_pixels(self, pixels: IntArray | BoolArray) -> Basis:
        """Return the basis at some of the pixels."""
        return Basis(self.mesh, self.cell[pixels], self.shape[pixels])

    def at(self, points: FloatArray) -> csr_array:
        """Return the functions at any points of the mesh.

        Args:
            points: X, Y [µm], shape (n, 2).

        Returns:
            Values, shape (n, n_functions).

        Raises:
            ValueError: a point lies outside the mesh.
        """
        cell, local = self.mesh.locate(points)
        outside = np.flatnonzero(cell < 0)
        if outside.size:
            raise ValueError(
                f"point {tuple(points[outside[0]].tolist())} µm lies outside the mesh of the basis."
            )
        return _matrix(self.mesh, cell, self.mesh.cell.shape(local))


@dataclass(frozen=True, eq=False)
class GridBasis(Basis):
    """Bilinear Q4 functions on a regular grid.

    Attributes:
        bounds: rectangle (x0, x1, y0, y1) of the grid [µm].
        cells: number of elements along X and Y; the nodes run fastest along Y.
    """

    bounds: tuple[float, float, float, float]
    cells: tuple[int, int]

    def interpolated(self, values: FloatArray, points: FloatArray) -> FloatArray:
        """Nodal values (n_functions, k) at points (n, 2) of the grid, shape (n, k)."""
        cell, shape = _place(points, self.bounds, self.cells)
        return np.asarray(np.einsum("na,nak->nk", shape, values[self.mesh.cells[cell]]))

    def at(self, points: FloatArray) -> csr_array:
        """Return the functions at any points of the grid; arguments as for any basis."""
        return _matrix(self.mesh, *_place(points, self.bounds, self.cells))


def basis_on(
    xy: FloatArray, bounds: tuple[float, float, float, float], mesh: float | PlaneMesh
) -> Basis:
    """Basis of a component over the region of interest.

    Args:
        xy: pixels of the region of interest [µm], shape (n_pixels, 2).
        bounds: rectangle (x0, x1, y0, y1) of a regular grid [µm].
        mesh: size of the elements of that grid [µm], or a mesh that holds all pixels.
    """
    if isinstance(mesh, PlaneMesh):
        return mesh_basis(xy, mesh)
    return grid_basis(xy, bounds, mesh)


def mesh_basis(xy: FloatArray, mesh: PlaneMesh) -> Basis:
    """Basis on any plane mesh.

    Args:
        xy: pixels of the region of interest [µm], shape (n_pixels, 2).
        mesh: the mesh, which holds them all.

    Raises:
        ValueError: the mesh is broken, or a pixel lies outside it.
    """
    mesh.check()
    cell, local = mesh.locate(xy)
    outside = np.flatnonzero(cell < 0)
    if outside.size:
        raise ValueError(
            f"{outside.size} of {len(xy)} pixels lie outside the mesh of the basis, the first at "
            f"{tuple(xy[outside[0]].tolist())} µm."
        )
    return Basis(mesh=mesh, cell=cell, shape=mesh.cell.shape(local))


def grid_basis(
    xy: FloatArray, bounds: tuple[float, float, float, float], element_size: float
) -> GridBasis:
    """Q4 basis on a regular grid that fills the bounds.

    Args:
        xy: pixels of the region of interest [µm], shape (n_pixels, 2).
        bounds: rectangle (x0, x1, y0, y1) that holds them [µm].
        element_size: wanted size of an element [µm]; the nearest size that divides each
            side of the rectangle is taken.

    Raises:
        ValueError: a pixel lies outside the bounds.
    """
    x0, x1, y0, y1 = bounds
    cells = (max(1, round((x1 - x0) / element_size)), max(1, round((y1 - y0) / element_size)))
    cell, shape = _place(xy, bounds, cells)
    mesh = _grid(bounds, cells)
    return GridBasis(mesh=mesh, cell=cell, shape=shape, bounds=bounds, cells=cells)


@dataclass(frozen=True, eq=False)
class PixelMotion:
    """u, v, w at the pixels in T frames, made of the nodal values for those that are asked for.

    Attributes:
        basis_uv: basis of u and of v.
        basis_w: basis of w.
        coefficients: nodal values [u | v | w] [µm], shape (T, n).
    """

    basis_uv: Basis
    basis_w: Basis
    coefficients: FloatArray

    def __getitem__(self, index: IntArray, /) -> FloatArray:
        """u, v, w in frames [µm], shape (len(index), n_pixels, 3)."""
        return motion_at_pixels(self.basis_uv, self.basis_w, self.coefficients[index])

    def at(self, pixels: IntArray) -> PixelMotion:
        """Return the motion at some of the pixels."""
        uv, w = (basis.at_pixels(pixels) for basis in (self.basis_uv, self.basis_w))
        return PixelMotion(uv, w, self.coefficients)


def motion_at_pixels(basis_uv: Basis, basis_w: Basis, p: FloatArray) -> FloatArray:
    """u, v, w at the pixels, shape (T, n_pixels, 3).

    Args:
        basis_uv: basis of u and of v.
        basis_w: basis of w.
        p: nodal values [u | v | w], shape (T, n).
    """
    uv, w = basis_uv, basis_w
    motion: FloatArray = motion_of(
        uv.mesh.cells, uv.cell, uv.shape, w.mesh.cells, w.cell, w.shape,
        np.ascontiguousarray(p.T), len(uv.nodes),
    )  # fmt: skip
    return motion.T


@lru_cache(maxsize=16)
def _grid(bounds: tuple[float, float, float, float], cells: tuple[int, int]) -> PlaneMesh:
    """Return the mesh of a grid: wanted again for each pair of images of one size."""
    x0, x1, y0, y1 = bounds
    x, y = np.meshgrid(
        np.linspace(x0, x1, cells[0] + 1), np.linspace(y0, y1, cells[1] + 1), indexing="ij"
    )
    index = np.arange(x.size).reshape(x.shape)
    corners = (index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    return PlaneMesh(
        points=np.column_stack([x.ravel(), y.ravel()]),
        cells=np.stack(corners, axis=-1).reshape(-1, 4),
        kind="quad4",
    )


def _place(
    points: FloatArray, bounds: tuple[float, float, float, float], cells: tuple[int, int]
) -> tuple[IntArray, FloatArray]:
    """Cell of each point and the four functions there."""
    cell, shape, worst = grid_places(np.ascontiguousarray(points), np.array(bounds), cells)
    if worst >= 0:
        raise ValueError(
            f"point {tuple(points[worst].tolist())} µm lies outside the bounds {bounds} "
            "of the basis."
        )
    return cell, shape


def _matrix(mesh: PlaneMesh, cell: IntArray, shape: FloatArray) -> csr_array:
    n, m = shape.shape
    indptr = np.arange(0, m * n + 1, m)
    return csr_array((shape.ravel(), mesh.cells[cell].ravel(), indptr), shape=(n, len(mesh.points)))

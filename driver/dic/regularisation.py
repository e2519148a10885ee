"""Quadratic penalties on nodal values: second differences, elastic energy, equilibrium gap."""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_diag, coo_array, csc_array, diags_array, eye_array, kron

from driver.dic.basis import Basis, GridBasis
from driver.dic.factor import DENSE, Matrix
from meshes.arrays import BoolArray, FloatArray
from meshes.plane_mesh import PlaneMesh

Penalty = Literal["tikhonov", "equilibrium_gap", "elastic"]
POISSON = 0.3


def penalties(basis_uv: Basis, basis_w: Basis, penalty: Penalty | None) -> list[Matrix]:
    """R of the motion and R of the height, over the nodal values [u | v | w], both (n, n).

    Each is free of dimension and scale, so that pᵀRp/roughness² counts standard deviations. Of
    u and v:

    - tikhonov (of second order): squares of the second differences ∂XX, ∂YY, ∂XY over
      a grid; on any other mesh, with G the gradient averaged at the nodes and h the element size,
      ∫ |∇u − G|² + h² |∇G|². An affine motion, and no other, costs nothing;
    - elastic: twice the energy of plane stress for E = 1, ν = 0.3, the edges free. A rigid
      motion costs nothing, a strain does;
    - equilibrium_gap: squares of the nodal forces KU inside the mesh, where equilibrium without
      body forces wants zero. An affine motion costs nothing.

    Of w: second differences on a grid, else the Laplacian inside the mesh.

    Args:
        basis_uv: basis of u and of v.
        basis_w: basis of w.
        penalty: of u and v; None for tikhonov on a grid and equilibrium_gap elsewhere.
    """
    if penalty is None:
        penalty = "tikhonov" if isinstance(basis_uv, GridBasis) else "equilibrium_gap"
    if penalty == "tikhonov":
        if isinstance(basis_uv, GridBasis) and isinstance(basis_w, GridBasis):
            if _size(basis_uv, basis_w) <= DENSE:
                return _dense_curvatures(basis_uv.cells, basis_w.cells)
        uv = csc_array(block_diag([_curvature(basis_uv)] * 2))
    elif penalty == "elastic":
        uv = plane_stress(basis_uv.mesh)
    else:
        uv = _gap(plane_stress(basis_uv.mesh), np.tile(~on_border(basis_uv.mesh), 2))
    if isinstance(basis_w, GridBasis):
        w = second_differences(basis_w.cells)
    else:
        w = _gap(_laplacian(basis_w.mesh), ~on_border(basis_w.mesh))
    n_uv, n_w = uv.shape[0], w.shape[0]
    both = [
        csc_array(block_diag([uv, csc_array((n_w, n_w))])),
        csc_array(block_diag([csc_array((n_uv, n_uv)), w])),
    ]
    return both if n_uv + n_w > DENSE else [part.toarray() for part in both]


def ranks(basis_uv: Basis, basis_w: Basis, penalty: Penalty | None) -> tuple[int, int]:
    """Ranks of both `penalties`, of the motion and of the height, see there."""
    free = len(basis_w.nodes) - 3
    if not isinstance(basis_w, GridBasis):
        free = int(np.count_nonzero(~on_border(basis_w.mesh)))
    return modes(basis_uv, penalty), free


def modes(basis_uv: Basis, penalty: Penalty | None) -> int:
    """Rank of R of the motion: what of u, v costs something.

    All nodal values but the affine motions (tikhonov) or the rigid ones (elastic); two for each
    node inside the mesh (equilibrium_gap), whose block of the stiffness is definite.

    Args:
        basis_uv: basis of u and of v.
        penalty: as in `penalties`.
    """
    free = 2 * len(basis_uv.nodes)
    if penalty == "elastic":
        return free - 3
    if penalty == "tikhonov" or (penalty is None and isinstance(basis_uv, GridBasis)):
        return free - 6
    return 2 * int(np.count_nonzero(~on_border(basis_uv.mesh)))


def _curvature(basis: Basis) -> csc_array:
    if isinstance(basis, GridBasis):
        return second_differences(basis.cells)
    mesh = basis.mesh
    slopes, areas = _slopes(mesh)
    n_cells, n_points, m, _ = slopes.shape
    at, weight = np.arange(n_cells * n_points), diags_array(areas.ravel())
    rows, nodes = np.repeat(at, m), np.repeat(mesh.cells, n_points, axis=0).ravel()

    def operator(values: FloatArray) -> csc_array:
        return csc_array(coo_array((values.ravel(), (rows, nodes)), (len(at), len(mesh.points))))

    shape = operator(np.tile(mesh.cell.shape(mesh.cell.quadrature[0]), (n_cells, 1)))
    along = [operator(slopes[..., axis]) for axis in (0, 1)]
    near = shape.multiply(shape).T @ weight
    mean = diags_array(1 / near.sum(axis=1)) @ near
    costs = []
    for slope in along:
        at_nodes = mean @ slope
        costs.append(slope - shape @ at_nodes)
        costs += [mesh.size * (change @ at_nodes) for change in along]
    return csc_array(sum(cost.T @ weight @ cost for cost in costs))


def _size(basis_uv: Basis, basis_w: Basis) -> int:
    return 2 * len(basis_uv.nodes) + len(basis_w.nodes)


@lru_cache(maxsize=16)
def _dense_curvatures(cells_uv: tuple[int, int], cells_w: tuple[int, int]) -> list[Matrix]:
    """Both curvature penalties of small grids: made of many small sparse products, so kept."""
    uv, w = (second_differences(cells).toarray() for cells in (cells_uv, cells_w))
    n, n_w = len(uv), len(w)
    motion, height = np.zeros((2, 2 * n + n_w, 2 * n + n_w))
    motion[:n, :n] = motion[n : 2 * n, n : 2 * n] = uv
    height[2 * n :, 2 * n :] = w
    return [motion, height]


def _gap(stiffness: csc_array, inside: BoolArray) -> csc_array:
    gap = diags_array(inside.astype(np.float64)) @ stiffness
    return csc_array(gap.T @ gap)


@lru_cache(maxsize=16)
def second_differences(cells: tuple[int, int]) -> csc_array:
    """RᵀR for the second differences ∂XX, ∂YY and ∂XY of nodal values, in nodal units.

    Args:
        cells: number of elements of the grid along X and Y, its nodes fastest along Y.
    """
    first = [_differences(n + 1, 1) for n in cells]
    second = [_differences(n + 1, 2) for n in cells]
    eye = [eye_array(n + 1) for n in cells]
    bending = (
        kron(second[0], eye[1]),
        kron(eye[0], second[1]),
        kron(first[0], first[1]),
    )
    return csc_array(sum(bend.T @ bend for bend in bending))


def plane_stress(mesh: PlaneMesh) -> csc_array:
    """Stiffness of the mesh in plane stress for E = 1 and unit thickness, (2 n, 2 n)."""
    shear = 0.5 * (1 - POISSON)
    law = np.array([[1, POISSON, 0], [POISSON, 1, 0], [0, 0, shear]]) / (1 - POISSON**2)
    slopes, weights = _slopes(mesh)
    n_cells, n_points, m, _ = slopes.shape
    strain = np.zeros((n_cells, n_points, 3, 2 * m))
    strain[:, :, 0, :m] = strain[:, :, 2, m:] = slopes[..., 0]
    strain[:, :, 1, m:] = strain[:, :, 2, :m] = slopes[..., 1]
    blocks = np.einsum("cqik,ij,cqjl,cq->ckl", strain, law, strain, weights, optimize=True)
    n = len(mesh.points)
    return _assembled(blocks, np.hstack([mesh.cells, mesh.cells + n]), 2 * n)


def _laplacian(mesh: PlaneMesh) -> csc_array:
    slopes, weights = _slopes(mesh)
    blocks = np.einsum("cqad,cqbd,cq->cab", slopes, slopes, weights, optimize=True)
    return _assembled(blocks, mesh.cells, len(mesh.points))


def on_border(mesh: PlaneMesh) -> BoolArray:
    """Whether each node lies on a side that belongs to one cell alone, shape (n_nodes,)."""
    n, cells = mesh.cell.n_corners, mesh.cells
    sides = np.stack([mesh.corners, np.roll(mesh.corners, -1, axis=1)], axis=-1).reshape(-1, 2)
    _, which, count = np.unique(
        np.sort(sides, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    single = count[which.ravel()] == 1
    border = np.zeros(len(mesh.points), dtype=bool)
    border[sides[single]] = True
    if mesh.cell.n_nodes > n:
        border[cells[:, n:].reshape(-1)[single]] = True
    return border


def _slopes(mesh: PlaneMesh) -> tuple[FloatArray, FloatArray]:
    """∂N/∂X, ∂N/∂Y at the Gauss points of each cell (c, q, m, 2), and their areas (c, q)."""
    at, weights = mesh.cell.quadrature
    reference = mesh.cell.gradient(at)
    maps = np.einsum("qai,cad->cqdi", reference, mesh.points[mesh.cells])
    slopes = np.einsum("qai,cqid->cqad", reference, np.linalg.inv(maps))
    return slopes, np.abs(np.linalg.det(maps)) * weights


def _assembled(blocks: FloatArray, dofs: NDArray[np.int64], n: int) -> csc_array:
    k = dofs.shape[1]
    rows, cols = np.repeat(dofs, k, axis=1).ravel(), np.tile(dofs, (1, k)).ravel()
    return csc_array(coo_array((blocks.ravel(), (rows, cols)), shape=(n, n)))


def _differences(n: int, order: int) -> csc_array:
    return csc_array(np.diff(np.eye(n), order, axis=0))

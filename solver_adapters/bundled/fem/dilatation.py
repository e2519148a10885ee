"""Mean dilatation: the cure of cells that are too stiff where plastic flow keeps the volume.

Such flow asks every Gauss point of a cell to keep its volume, and a cell with many of them can
hardly move (Nagtegaal, Parks and Rice, Comput. Methods Appl. Mech. Eng. 4, 1974). The dilatation
θ = tr ∇u is therefore replaced by its projection Πθ on few functions in each cell (Simo, Taylor and
Pister, ibid. 51, 1985): its mean in a tetrahedron, a linear function in a hexahedron.

    H̄ = H + R (Π − 1)(R : H) / 3,   H = ∇u·R

with R the crystal → specimen rotation, so that R : H = θ. Π is the projection in the inner product
of the Gauss weights: the same map turns P into the P̄ with Σ w P : H̄ = Σ w P̄ : H for every H. The
map is linear in u, in finite strain too, and leaves homogeneous motions alone, rotations among
them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import prange

from meshes.arrays import AnyArray, BoolArray, FloatArray, IntArray
from solver_adapters.kernels import batch_kernel

_STEP = 1e-30


@dataclass(frozen=True, eq=False)
class Dilatation:
    """The map of a mesh.

    Attributes:
        change: Π − 1 of each cell, (n_cells, n_gauss, n_gauss).
        axes: rotation R of each Gauss point, row by row, (n_points, 9).
        divergence: (Π − 1) of the divergence of a motion of each node [1/µm],
            (n_cells, n_gauss, 3, n).
    """

    change: FloatArray
    axes: FloatArray
    divergence: FloatArray

    def project(self, values: FloatArray) -> None:
        """Map H or P (n_points, 9), in place."""
        _project(self.change, self.axes, values)

    def project_directions(self, values: FloatArray) -> None:
        """Map derivatives of H or P along k directions (n_points, 9, k), in place."""
        _project_directions(self.change, self.axes, values)

    def add_changes(
        self,
        values: FloatArray,
        changes: DilatationChanges,
        changed: BoolArray,
        where: IntArray,
        directions: FloatArray,
    ) -> None:
        """Add what changes of the map do to the derivatives of H̄ or P̄.

        Args:
            values: H or P, not mapped, (n_points, 9).
            changes: derivatives of the map along g directions.
            changed: whether a direction changes anything in a cell, (g, n_cells).
            where: columns of these directions among all k, (g,).
            directions: added to, (n_points, 9, k).
        """
        of_map = changes.change, changes.axes, changes.row
        _add_changes(self.change, self.axes, *of_map, changed, where, values, directions)


@dataclass(frozen=True, eq=False)
class DilatationChanges:
    """Derivatives of the map along g directions, each of which moves nodes or turns crystals.

    Attributes:
        change: of `Dilatation.change` along the m that move nodes, (m, n_cells, n_gauss, n_gauss).
        axes: of `Dilatation.axes`, (g, n_points, 9).
        row: of each direction in `change`, −1 where its nodes stay, (g,).
    """

    change: FloatArray
    axes: FloatArray
    row: IntArray


def mean_dilatation(
    functions: FloatArray,
    gradients: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
    frame_of: IntArray,
) -> Dilatation:
    """Return the map of a mesh.

    Args:
        functions: those that the dilatation of a cell follows, at its Gauss points,
            (n_gauss, n_functions).
        gradients: shape gradients in the specimen frame [1/µm], (n_cells, n_gauss, n, 3).
        weights: Gauss weights [µm³], (n_cells, n_gauss).
        rotation: crystal → specimen rotations, (n_frames, 3, 3).
        frame_of: row of `rotation` of each Gauss point, (n_points,).
    """
    change = projection(functions, weights) - np.eye(len(functions))
    divergence = np.einsum("eqr,eraj->eqja", change, gradients, optimize=True)
    axes = np.ascontiguousarray(rotation.reshape(-1, 9)[frame_of])
    return Dilatation(np.ascontiguousarray(change), axes, np.ascontiguousarray(divergence))


def dilatation_changes(
    functions: FloatArray,
    weights: FloatArray,
    weight_changes: Sequence[FloatArray],
    rotation_changes: Sequence[FloatArray],
    frame_of: IntArray,
) -> DilatationChanges:
    """Return the derivatives of the map where the weights and the rotations change.

    Args:
        functions: as of `mean_dilatation`.
        weights: likewise.
        weight_changes: change of the weights along each of g directions, shape of these.
        rotation_changes: change of the rotations along each, (n_frames, 3, 3).
        frame_of: row of a rotation of each Gauss point, (n_points,).
    """
    moves = np.array([bool(change.any()) for change in weight_changes])
    moved = [
        projection(functions, weights + 1j * _STEP * change).imag / _STEP
        for change, moving in zip(weight_changes, moves, strict=True)
        if moving
    ]
    n_gauss = len(functions)
    return DilatationChanges(
        np.array(moved).reshape(len(moved), len(weights), n_gauss, n_gauss),
        np.array([change.reshape(-1, 9)[frame_of] for change in rotation_changes]),
        np.where(moves, np.cumsum(moves) - 1, -1),
    )


def projection(functions: FloatArray, weights: AnyArray) -> AnyArray:
    """Projection on functions in the inner product of weights (n_cells, n_gauss), Π of each cell.

    Π = Ψ (ΨᵀWΨ)⁻¹ ΨᵀW, shape (n_cells, n_gauss, n_gauss).
    """
    weighted = functions.T * weights[:, None, :]
    return np.asarray(functions @ np.linalg.solve(weighted @ functions, weighted))


@batch_kernel
def _project(change: FloatArray, axes: FloatArray, values: FloatArray) -> None:
    n_gauss = change.shape[1]
    for e in prange(change.shape[0]):
        trace = np.empty(n_gauss)
        for q in range(n_gauss):
            total = 0.0
            for m in range(9):
                total += axes[n_gauss * e + q, m] * values[n_gauss * e + q, m]
            trace[q] = total
        for q in range(n_gauss):
            added = 0.0
            for r in range(n_gauss):
                added += change[e, q, r] * trace[r]
            for m in range(9):
                values[n_gauss * e + q, m] += axes[n_gauss * e + q, m] * added / 3.0


@batch_kernel
def _project_directions(change: FloatArray, axes: FloatArray, values: FloatArray) -> None:
    n_gauss, width = change.shape[1], values.shape[2]
    for e in prange(change.shape[0]):
        trace = np.zeros((n_gauss, width))
        for q in range(n_gauss):
            for m in range(9):
                share = axes[n_gauss * e + q, m]
                row = values[n_gauss * e + q, m]
                for k in range(width):
                    trace[q, k] += share * row[k]
        added = np.empty(width)
        for q in range(n_gauss):
            added[:] = 0.0
            for r in range(n_gauss):
                for k in range(width):
                    added[k] += change[e, q, r] * trace[r, k]
            for m in range(9):
                share = axes[n_gauss * e + q, m] / 3.0
                row = values[n_gauss * e + q, m]
                for k in range(width):
                    row[k] += share * added[k]


@batch_kernel
def _add_changes(
    change: FloatArray,
    axes: FloatArray,
    moved: FloatArray,
    turned: FloatArray,
    row: IntArray,
    changed: BoolArray,
    where: IntArray,
    values: FloatArray,
    directions: FloatArray,
) -> None:
    n_gauss = change.shape[1]
    for e in prange(change.shape[0]):
        first = n_gauss * e
        trace, along_change, turning = np.empty(n_gauss), np.empty(n_gauss), np.empty(n_gauss)
        for q in range(n_gauss):
            trace[q] = 0.0
            for m in range(9):
                trace[q] += axes[first + q, m] * values[first + q, m]
        for q in range(n_gauss):
            along_change[q] = 0.0
            for r in range(n_gauss):
                along_change[q] += change[e, q, r] * trace[r]
        for g in range(turned.shape[0]):
            if not changed[g, e]:
                continue
            for q in range(n_gauss):
                turning[q] = 0.0
                for m in range(9):
                    turning[q] += turned[g, first + q, m] * values[first + q, m]
            for q in range(n_gauss):
                along_axes = 0.0
                for r in range(n_gauss):
                    along_axes += change[e, q, r] * turning[r]
                if row[g] >= 0:
                    for r in range(n_gauss):
                        along_axes += moved[row[g], e, q, r] * trace[r]
                for m in range(9):
                    directions[first + q, m, where[g]] += (
                        axes[first + q, m] * along_axes + turned[g, first + q, m] * along_change[q]
                    ) / 3.0

"""Gather and scatter between nodes and Gauss points, and the sparse pattern of the stiffness."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from solver_adapters.bundled.compilation import batch_kernel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_N = 30


@batch_kernel
def displacement_gradients(
    u: FloatArray, cells: IntArray, gradients: FloatArray, H: FloatArray
) -> None:
    """H[4e+q, 3i+j] = Σ_a u[a, i] G[e, q, a, j]; u (n_nodes, 3), H (n_points, 9)."""
    for e in prange(cells.shape[0]):
        for q in range(4):
            for i in range(3):
                for j in range(3):
                    total = 0.0
                    for a in range(10):
                        total += u[cells[e, a], i] * gradients[e, q, a, j]
                    H[4 * e + q, 3 * i + j] = total


@batch_kernel
def direction_gradients(
    du: FloatArray, cells: IntArray, gradients: FloatArray, dH: FloatArray
) -> None:
    """Add to dH[4e+q, k, 3i+j] the gradient of du (n_nodes, 3, k)."""
    for e in prange(cells.shape[0]):
        for q in range(4):
            for a in range(10):
                node = cells[e, a]
                for k in range(du.shape[2]):
                    for i in range(3):
                        value = du[node, i, k]
                        for j in range(3):
                            dH[4 * e + q, k, 3 * i + j] += value * gradients[e, q, a, j]


@batch_kernel
def element_forces(
    P: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
) -> None:
    """forces[e, 3a+i] = Σ_q w P[i, :]·G[a, :]."""
    for e in prange(weights.shape[0]):
        for a in range(10):
            for i in range(3):
                total = 0.0
                for q in range(4):
                    for j in range(3):
                        total += weights[e, q] * P[4 * e + q, 3 * i + j] * gradients[e, q, a, j]
                forces[e, 3 * a + i] = total


@batch_kernel
def direction_forces(
    dP: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
) -> None:
    """forces[e, 3a+i, k] = Σ_q w dP[k, i, :]·G[a, :]."""
    for e in prange(weights.shape[0]):
        for a in range(10):
            for i in range(3):
                for k in range(dP.shape[1]):
                    total = 0.0
                    for q in range(4):
                        for j in range(3):
                            total += (
                                weights[e, q] * dP[4 * e + q, k, 3 * i + j] * gradients[e, q, a, j]
                            )
                    forces[e, 3 * a + i, k] = total


@batch_kernel
def element_stiffness(
    C: FloatArray, gradients: FloatArray, weights: FloatArray, K: FloatArray
) -> None:
    """Lower triangle of each element stiffness, K (n_cells, 465)."""
    for e in prange(weights.shape[0]):
        half = np.empty((30, 9))
        for m in range(465):
            K[e, m] = 0.0
        for q in range(4):
            for a in range(10):
                g0 = gradients[e, q, a, 0] * weights[e, q]
                g1 = gradients[e, q, a, 1] * weights[e, q]
                g2 = gradients[e, q, a, 2] * weights[e, q]
                for i in range(3):
                    for m in range(9):
                        half[3 * a + i, m] = (
                            g0 * C[4 * e + q, 3 * i, m]
                            + g1 * C[4 * e + q, 3 * i + 1, m]
                            + g2 * C[4 * e + q, 3 * i + 2, m]
                        )
            slot = 0
            for row in range(30):
                for column in range(row + 1):
                    b = column // 3
                    j = 3 * (column - 3 * b)
                    K[e, slot] += (
                        half[row, j] * gradients[e, q, b, 0]
                        + half[row, j + 1] * gradients[e, q, b, 1]
                        + half[row, j + 2] * gradients[e, q, b, 2]
                    )
                    slot += 1


@dataclass(frozen=True, eq=False)
class Pattern:
    """Lower triangle (CSC, sorted) of the stiffness on the free degrees of freedom.

    Attributes:
        free: free degrees of freedom 3·node + component, shape (n_free,).
        indptr, indices: compressed columns.
        slots: where each entry of each element's lower triangle goes, shape (n_cells·465,);
            entries on prescribed degrees of freedom go to slot `nnz`.
        dofs: degrees of freedom of each cell, shape (n_cells, 30).
    """

    free: IntArray
    indptr: IntArray
    indices: IntArray
    slots: IntArray
    dofs: IntArray

    @property
    def nnz(self) -> int:
        """Number of stored entries."""
        return self.indices.size

    def values(self, element_matrices: FloatArray) -> FloatArray:
        """Sum element lower triangles (n_cells, 465) into the stored entries."""
        summed = np.bincount(self.slots, element_matrices.ravel(), minlength=self.nnz + 1)
        return np.asarray(summed[: self.nnz], dtype=np.float64)

    def node_sum(self, element_vectors: FloatArray, n_nodes: int) -> FloatArray:
        """Sum element vectors (n_cells, 30) into a vector of all degrees of freedom."""
        summed = np.bincount(self.dofs.ravel(), element_vectors.ravel(), minlength=3 * n_nodes)
        return np.asarray(summed, dtype=np.float64)

    def node_sums(self, element_vectors: FloatArray, n_nodes: int) -> FloatArray:
        """Sum element vectors (n_cells, 30, k) into (3·n_nodes, k)."""
        columns = [
            self.node_sum(np.ascontiguousarray(element_vectors[:, :, k]), n_nodes)
            for k in range(element_vectors.shape[2])
        ]
        return np.stack(columns, axis=1)


def stiffness_pattern(cells: IntArray, prescribed: BoolArray) -> Pattern:
    """Pattern for tet10 cells (n_cells, 10) and prescribed degrees of freedom (3·n_nodes,)."""
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), _N)
    free = np.flatnonzero(~prescribed)
    number = np.full(prescribed.size, -1, dtype=np.int64)
    number[free] = np.arange(free.size)
    rows, columns = np.tril_indices(_N)
    first, second = number[dofs[:, rows]], number[dofs[:, columns]]
    inside = (first >= 0) & (second >= 0)
    key = np.where(inside, np.minimum(first, second) * free.size + np.maximum(first, second), -1)
    unique, inverse = np.unique(key.ravel(), return_inverse=True)
    skipped = int(unique[0] == -1)
    unique = unique[skipped:]
    slots = inverse.ravel() - skipped
    slots[slots < 0] = unique.size
    return Pattern(
        free=free,
        indptr=np.searchsorted(unique // free.size, np.arange(free.size + 1)).astype(np.int64),
        indices=(unique % free.size).astype(np.int64),
        slots=slots.astype(np.int64),
        dofs=dofs,
    )

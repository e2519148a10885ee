"""Gather and scatter between nodes and Gauss points, and the sparse pattern of the stiffness.

The kernels are made once for each element, so that its numbers of nodes and Gauss points are
constants in the loops: n nodes, N = 3n degrees of freedom, n_gauss points of a cell, which are
the rows n_gauss·cell + q of arrays over all points. Vectors of an element have the order
3·node + component.

The stiffness of an element is stored as its lower triangle, column by column, in the order
n·component + node: so every inner loop runs over neighbours in memory.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.bundled.fem.dilatation import Dilatation
from solver_adapters.kernels import batch_kernel, kernels_for, loop_kernel


def displacement_gradients(
    u: FloatArray, cells: IntArray, gradients: FloatArray, H: FloatArray
) -> None:
    """H[n_gauss·e+q, 3i+j] = Σ_a u[a, i] G[e, q, a, j]; u (n_nodes, 3), H (n_points, 9)."""
    _displacement_gradients(*gradients.shape[1:3])(u, cells, gradients, H)


def direction_gradients(
    du: FloatArray, cells: IntArray, gradients: FloatArray, dH: FloatArray
) -> None:
    """Set dH[n_gauss·e+q, 3i+j, k] to the gradient of du (n_nodes, 3, k)."""
    _direction_gradients(*gradients.shape[1:3])(du, cells, gradients, dH)


def element_forces(
    P: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
) -> None:
    """forces[e, 3a+i] = Σ_q w P[i, :]·G[a, :]; P (n_points, 9), forces (n_cells, N)."""
    _element_forces(*gradients.shape[1:3])(P, gradients, weights, forces)


def direction_forces(
    dP: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
) -> None:
    """forces[e, 3a+i, k] = Σ_q w dP[i, :, k]·G[a, :]; forces (n_cells, N, k)."""
    _direction_forces(*gradients.shape[1:3])(dP, gradients, weights, forces)


def add_gradient_changes(
    u: FloatArray,
    cells: IntArray,
    changes: FloatArray,
    changed: BoolArray,
    where: IntArray,
    dH: FloatArray,
) -> None:
    """Add to dH what changes of the shape gradients along some directions make of it.

    Args:
        u: displacement, (n_nodes, 3).
        cells: connectivity, (n_cells, n).
        changes: of the gradients, (g, n_cells, n_gauss, n, 3).
        changed: the cells where they are not null, (g, n_cells).
        where: the directions, (g,).
        dH: (n_points, 9, k), added to.
    """
    _add_gradient_changes(*changes.shape[2:4])(u, cells, changes, changed, where, dH)


def add_force_changes(
    P: FloatArray, changes: FloatArray, changed: BoolArray, where: IntArray, forces: FloatArray
) -> None:
    """Add to forces (n_cells, N, k) what changes of the weighted gradients make at stress P.

    `changes`, `changed` and `where` as in `add_gradient_changes`; P (n_points, 9).
    """
    _add_force_changes(*changes.shape[2:4])(P, changes, changed, where, forces)


def element_stiffness(
    C: FloatArray,
    gradients: FloatArray,
    weights: FloatArray,
    K: FloatArray,
    part: int = 0,
    dilatation: Dilatation | None = None,
) -> None:
    """Lower triangle of each element stiffness.

    Args:
        C: tangents, (n_points, 9, 9).
        gradients: shape gradients, (n_cells, n_gauss, n, 3).
        weights: (n_cells, n_gauss).
        K: filled with the triangles, (n_cells, N (N + 1)/2).
        part: 0 for the stiffness as it is (a symmetric tangent), 1 for its symmetric part
            (K + Kᵀ)/2, −1 for its antisymmetric part (K − Kᵀ)/2 at row ≥ column.
        dilatation: how H is mapped, None where it is not.
    """
    # The parts of K are the stiffnesses of the parts of C.
    n_gauss, n = gradients.shape[1:3]
    _element_stiffness(n_gauss, n)(C, gradients, weights, K, part)
    if dilatation is not None:
        add_projected_stiffness(C, gradients, weights, K, part, dilatation)


def add_projected_stiffness(
    C: FloatArray,
    gradients: FloatArray,
    weights: FloatArray,
    K: FloatArray,
    part: int,
    dilatation: Dilatation,
) -> None:
    """Add to K what the map of H makes of the stiffness; arguments as in `element_stiffness`."""
    _add_projected_stiffness(*gradients.shape[1:3])(
        C, gradients, weights, dilatation.axes, dilatation.divergence, K, part
    )


@kernels_for
def _displacement_gradients(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def displacement_gradients(
        u: FloatArray, cells: IntArray, gradients: FloatArray, H: FloatArray
    ) -> None:
        for e in prange(cells.shape[0]):
            for q in range(n_gauss):
                for i in range(3):
                    for j in range(3):
                        total = 0.0
                        for a in range(n):
                            total += u[cells[e, a], i] * gradients[e, q, a, j]
                        H[n_gauss * e + q, 3 * i + j] = total

    return displacement_gradients


@kernels_for
def _direction_gradients(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def direction_gradients(
        du: FloatArray, cells: IntArray, gradients: FloatArray, dH: FloatArray
    ) -> None:
        for e in prange(cells.shape[0]):
            width = du.shape[2]
            motion = np.empty((n, 3, width))
            for a in range(n):
                motion[a] = du[cells[e, a]]
            for q in range(n_gauss):
                g = gradients[e, q]
                for i in range(3):
                    for j in range(3):
                        row = dH[n_gauss * e + q, 3 * i + j]
                        for k in range(width):
                            value = 0.0
                            for a in range(n):
                                value += motion[a, i, k] * g[a, j]
                            row[k] = value

    return direction_gradients


@kernels_for
def _element_forces(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def element_forces(
        P: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
    ) -> None:
        for e in prange(weights.shape[0]):
            for a in range(n):
                for i in range(3):
                    total = 0.0
                    for q in range(n_gauss):
                        for j in range(3):
                            total += (
                                weights[e, q]
                                * P[n_gauss * e + q, 3 * i + j]
                                * gradients[e, q, a, j]
                            )
                    forces[e, 3 * a + i] = total

    return element_forces


@kernels_for
def _direction_forces(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def direction_forces(
        dP: FloatArray, gradients: FloatArray, weights: FloatArray, forces: FloatArray
    ) -> None:
        for e in prange(weights.shape[0]):
            width = dP.shape[2]
            stress = np.empty((n_gauss, 9, width))
            for q in range(n_gauss):
                given = dP[n_gauss * e + q]
                for m in range(9):
                    for k in range(width):
                        stress[q, m, k] = weights[e, q] * given[m, k]
            g = gradients[e]
            for a in range(n):
                for i in range(3):
                    force = forces[e, 3 * a + i]
                    for k in range(width):
                        total = 0.0
                        for q in range(n_gauss):
                            total += (
                                stress[q, 3 * i, k] * g[q, a, 0]
                                + stress[q, 3 * i + 1, k] * g[q, a, 1]
                                + stress[q, 3 * i + 2, k] * g[q, a, 2]
                            )
                        force[k] = total

    return direction_forces


@kernels_for
def _add_gradient_changes(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def add_gradient_changes(
        u: FloatArray,
        cells: IntArray,
        changes: FloatArray,
        changed: BoolArray,
        where: IntArray,
        dH: FloatArray,
    ) -> None:
        for e in prange(cells.shape[0]):
            for g in range(changes.shape[0]):
                if not changed[g, e]:
                    continue
                for q in range(n_gauss):
                    for i in range(3):
                        for j in range(3):
                            total = 0.0
                            for a in range(n):
                                total += u[cells[e, a], i] * changes[g, e, q, a, j]
                            dH[n_gauss * e + q, 3 * i + j, where[g]] += total

    return add_gradient_changes


@kernels_for
def _add_force_changes(n_gauss: int, n: int) -> Any:
    @batch_kernel
    def add_force_changes(
        P: FloatArray,
        changes: FloatArray,
        changed: BoolArray,
        where: IntArray,
        forces: FloatArray,
    ) -> None:
        for e in prange(forces.shape[0]):
            for g in range(changes.shape[0]):
                if not changed[g, e]:
                    continue
                for a in range(n):
                    for i in range(3):
                        total = 0.0
                        for q in range(n_gauss):
                            for j in range(3):
                                total += P[n_gauss * e + q, 3 * i + j] * changes[g, e, q, a, j]
                        forces[e, 3 * a + i, where[g]] += total

    return add_force_changes


@kernels_for
def _element_stiffness(n_gauss: int, n: int) -> Any:
    N = 3 * n

    @batch_kernel
    def element_stiffness(
        C: FloatArray, gradients: FloatArray, weights: FloatArray, K: FloatArray, part: int
    ) -> None:
        for e in prange(weights.shape[0]):
            g = np.empty((n_gauss, 3, n))
            c = np.empty((9, 9))
            # half[m, q, n·i + a] = w Σ_J G[a, J] C[3i + J, m]
            half = np.empty((9, n_gauss, N))
            for q in range(n_gauss):
                w = weights[e, q]
                given = C[n_gauss * e + q]
                for i in range(9):
                    for m in range(9):
                        c[i, m] = w * given[i, m]
                if part != 0:
                    for i in range(9):
                        for m in range(9):
                            c[i, m] = 0.5 * w * (given[i, m] + part * given[m, i])
                for a in range(n):
                    for j in range(3):
                        g[q, j, a] = gradients[e, q, a, j]
                for m in range(9):
                    row = half[m, q]
                    for i in range(3):
                        c0, c1, c2 = c[3 * i, m], c[3 * i + 1, m], c[3 * i + 2, m]
                        for a in range(n):
                            row[n * i + a] = c0 * g[q, 0, a] + c1 * g[q, 1, a] + c2 * g[q, 2, a]
            slot = 0
            triangle = K[e]
            for k in range(3):
                for b in range(n):
                    column = n * k + b
                    for i in range(column, N):
                        total = 0.0
                        for q in range(n_gauss):
                            total += (
                                half[3 * k, q, i] * g[q, 0, b]
                                + half[3 * k + 1, q, i] * g[q, 1, b]
                                + half[3 * k + 2, q, i] * g[q, 2, b]
                            )
                        triangle[slot + i - column] = total
                    slot += N - column

    return element_stiffness


@kernels_for
def _add_projected_stiffness(n_gauss: int, n: int) -> Any:
    """Make the stiffness of H one of H + R D u / 3, D the rows of `Dilatation.divergence`."""
    N = 3 * n

    @batch_kernel
    def add_projected_stiffness(
        C: FloatArray,
        gradients: FloatArray,
        weights: FloatArray,
        axes: FloatArray,
        divergence: FloatArray,
        K: FloatArray,
        part: int,
    ) -> None:
        mirrored = -1.0 if part == -1 else 1.0
        for e in prange(weights.shape[0]):
            # left[q, n·i + a] = w/3 Σ_J G[a, J] (C R)[3i + J] + w/18 (R C R) D
            left = np.empty((n_gauss, N))
            rows = divergence[e].copy().reshape(n_gauss, N)
            stress = np.empty(9)
            for q in range(n_gauss):
                third = weights[e, q] / 3.0
                given, R = C[n_gauss * e + q], axes[n_gauss * e + q]
                for i in range(9):
                    total = 0.0
                    for m in range(9):
                        if part == 0:
                            total += given[i, m] * R[m]
                        else:
                            total += 0.5 * (given[i, m] + part * given[m, i]) * R[m]
                    stress[i] = third * total
                half = 0.0
                for i in range(9):
                    half += R[i] * stress[i] / 6.0
                for i in range(3):
                    for a in range(n):
                        left[q, n * i + a] = half * rows[q, n * i + a] + (
                            stress[3 * i] * gradients[e, q, a, 0]
                            + stress[3 * i + 1] * gradients[e, q, a, 1]
                            + stress[3 * i + 2] * gradients[e, q, a, 2]
                        )
            slot = 0
            triangle = K[e]
            for column in range(N):
                for q in range(n_gauss):
                    across, along = rows[q, column], mirrored * left[q, column]
                    for i in range(column, N):
                        triangle[slot + i - column] += left[q, i] * across + rows[q, i] * along
                slot += N - column

    return add_projected_stiffness


@loop_kernel
def _sum_slots(slots: IntArray, element_matrices: FloatArray, values: FloatArray) -> None:
    for e in range(slots.shape[0]):
        for m in range(slots.shape[1]):
            values[slots[e, m]] += element_matrices[e, m]


@loop_kernel
def _sum_signed_slots(
    slots: IntArray, flipped: BoolArray, element_matrices: FloatArray, values: FloatArray
) -> None:
    for e in range(slots.shape[0]):
        for m in range(slots.shape[1]):
            value = element_matrices[e, m]
            values[slots[e, m]] += -value if flipped[e, m] else value


@loop_kernel
def _sum_nodes(dofs: IntArray, element_vectors: FloatArray, sums: FloatArray) -> None:
    for e in range(dofs.shape[0]):
        for i in range(dofs.shape[1]):
            for k in range(sums.shape[1]):
                sums[dofs[e, i], k] += element_vectors[e, i, k]


@dataclass(frozen=True, eq=False)
class Pattern:
    """Lower triangle (CSC, sorted) of the stiffness on the free degrees of freedom.

    Attributes:
        free: free degrees of freedom 3·node + component, shape (n_free,).
        indptr, indices: compressed columns, of 4 bytes as `slots`: fewer than 2³¹ entries.
        slots: where each entry of each element's lower triangle goes, shape
            (n_cells, N (N + 1)/2); entries on prescribed degrees of freedom go to slot `nnz`.
        flipped: whether the entry lies in the upper triangle of the whole, so that its mirror is
            stored, shape of `slots`.
        dofs: degrees of freedom of each cell, shape (n_cells, N).
    """

    free: IntArray
    indptr: IntArray
    indices: IntArray
    slots: IntArray
    flipped: BoolArray
    dofs: IntArray

    @property
    def nnz(self) -> int:
        """Number of stored entries."""
        return self.indices.size

    def values(self, element_matrices: FloatArray) -> FloatArray:
        """Sum element lower triangles (n_cells, N (N + 1)/2) into the stored entries."""
        summed = np.zeros(self.nnz + 1)
        _sum_slots(self.slots, element_matrices, summed)
        return summed[:-1]

    def antisymmetric_values(self, element_matrices: FloatArray) -> FloatArray:
        """Do the same for antisymmetric matrices, where an entry and its mirror differ in sign."""
        summed = np.zeros(self.nnz + 1)
        _sum_signed_slots(self.slots, self.flipped, element_matrices, summed)
        summed[self.indptr[:-1]] = 0.0  # the diagonal leads its column; rounding is left there
        return summed[:-1]

    def node_sum(self, element_vectors: FloatArray, n_nodes: int) -> FloatArray:
        """Sum element vectors (n_cells, N) into a vector of all degrees of freedom."""
        return self.node_sums(element_vectors[:, :, None], n_nodes)[:, 0]

    def node_sums(self, element_vectors: FloatArray, n_nodes: int) -> FloatArray:
        """Sum element vectors (n_cells, N, k) into (3·n_nodes, k)."""
        sums = np.zeros((3 * n_nodes, element_vectors.shape[2]))
        _sum_nodes(self.dofs, element_vectors, sums)
        return sums


def stiffness_pattern(cells: IntArray, prescribed: BoolArray) -> Pattern:
    """Pattern for cells (n_cells, n) and prescribed degrees of freedom (3·n_nodes,)."""
    degrees = 3 * cells[:, :, None] + np.arange(3)
    by_component = degrees.transpose(0, 2, 1).reshape(len(cells), -1)
    free = np.flatnonzero(~prescribed)
    number = np.full(prescribed.size, -1, dtype=np.int64)
    number[free] = np.arange(free.size)
    columns, rows = np.triu_indices(by_component.shape[1])
    first, second = number[by_component[:, rows]], number[by_component[:, columns]]
    inside = (first >= 0) & (second >= 0)
    key = np.where(inside, np.minimum(first, second) * free.size + np.maximum(first, second), -1)
    unique, inverse = np.unique(key.ravel(), return_inverse=True)
    skipped = int(unique[0] == -1)
    unique = unique[skipped:]
    slots = inverse.reshape(key.shape) - skipped
    slots[slots < 0] = unique.size
    return Pattern(
        free=free,
        indptr=np.searchsorted(unique // free.size, np.arange(free.size + 1)).astype(np.int32),
        indices=(unique % free.size).astype(np.int32),
        slots=slots.astype(np.int32),
        flipped=first < second,
        dofs=degrees.reshape(len(cells), -1),
    )

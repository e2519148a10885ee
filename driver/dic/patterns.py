"""Loops over the entries of symmetric matrices: sums of blocks, and one pattern for many."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.kernels import compiled

_compiled = compiled(nogil=True)


@_compiled
def summed_dense(blocks: FloatArray, dofs: IntArray, n: int) -> FloatArray:
    """Return the symmetric sum of packed lower triangles.

    Args:
        blocks: rows of the triangle one after the other, shape (n_blocks, k (k + 1) / 2).
        dofs: unknowns of each block, (n_blocks, k).
        n: size of the sum.
    """
    total = np.zeros((n, n))
    for q in range(len(dofs)):
        at = 0
        for i in range(dofs.shape[1]):
            row = dofs[q, i]
            for j in range(i):
                value = blocks[q, at + j]
                total[row, dofs[q, j]] += value
                total[dofs[q, j], row] += value
            total[row, row] += blocks[q, at + i]
            at += i + 1
    return total


@_compiled
def summed_sparse(
    blocks: FloatArray, dofs: IntArray, n: int
) -> tuple[FloatArray, IntArray, IntArray]:
    """Return the same sum as the data, indices (sorted) and indptr of a CSC matrix, both triangles.

    Args:
        blocks: as in `summed_dense`.
        dofs: as in `summed_dense`.
        n: as in `summed_dense`.
    """
    n_blocks, k = dofs.shape
    first = np.zeros(n + 1, np.int64)
    for q in range(n_blocks):
        for a in range(k):
            first[dofs[q, a] + 1] += 1
    first = np.cumsum(first)
    member, fill = np.empty(n_blocks * k, np.int64), first[:-1].copy()
    for q in range(n_blocks):
        for a in range(k):
            member[fill[dofs[q, a]]] = q * k + a
            fill[dofs[q, a]] += 1
    seen, indptr = np.full(n, -1, np.int64), np.zeros(n + 1, np.int64)
    for column in range(n):
        count = 0
        for m in member[first[column] : first[column + 1]]:
            for row in dofs[m // k]:
                if seen[row] != column:
                    seen[row] = column
                    count += 1
        indptr[column + 1] = indptr[column] + count
    indices, data = np.empty(indptr[n], np.int64), np.empty(indptr[n])
    seen[:] = -1
    work = np.zeros(n)
    for column in range(n):
        start = end = indptr[column]
        for m in member[first[column] : first[column + 1]]:
            q, a = m // k, m % k
            for b in range(k):
                row = dofs[q, b]
                if seen[row] != column:
                    seen[row] = column
                    work[row] = 0.0
                    at = end  # inserted in order: a column is short
                    while at > start and indices[at - 1] > row:
                        indices[at] = indices[at - 1]
                        at -= 1
                    indices[at] = row
                    end += 1
                low, high = min(a, b), max(a, b)
                work[row] += blocks[q, high * (high + 1) // 2 + low]
        for at in range(start, end):
            data[at] = work[indices[at]]
    return data, indices, indptr


@_compiled
def lower_union(
    indptr: IntArray, indices: IntArray, other_indptr: IntArray, other_indices: IntArray
) -> tuple[IntArray, IntArray]:
    """Columns and rows (CSC) of all entries on and below the diagonal of either CSC pattern.

    The whole diagonal belongs to it.

    Args:
        indptr: of one matrix, (n + 1,).
        indices: its rows, increasing within a column.
        other_indptr: of the other.
        other_indices: its rows.
    """
    n = len(indptr) - 1
    union_indptr = np.zeros(n + 1, np.int64)
    union = np.empty(len(indices) + len(other_indices) + n, np.int64)
    count = 0
    for column in range(n):
        i, i_end = indptr[column], indptr[column + 1]
        j, j_end = other_indptr[column], other_indptr[column + 1]
        union[count] = column
        count += 1
        while i < i_end or j < j_end:
            a = indices[i] if i < i_end else n
            b = other_indices[j] if j < j_end else n
            row = min(a, b)
            i += a == row
            j += b == row
            if row > column:
                union[count] = row
                count += 1
        union_indptr[column + 1] = count
    return union_indptr, union[:count].copy()


@_compiled
def spread(
    pattern_indptr: IntArray,
    pattern: IntArray,
    indptr: IntArray,
    indices: IntArray,
    data: FloatArray,
) -> FloatArray:
    """Lower triangle of a CSC matrix on a pattern that holds it, shape (entries of it,).

    Args:
        pattern_indptr: of the pattern.
        pattern: its rows, increasing within a column.
        indptr: of the matrix.
        indices: its rows, increasing within a column.
        data: its values.
    """
    values = np.zeros(len(pattern))
    for column in range(len(indptr) - 1):
        at = pattern_indptr[column]
        for i in range(indptr[column], indptr[column + 1]):
            if indices[i] < column:
                continue
            while pattern[at] < indices[i]:
                at += 1
            values[at] = data[i]
    return values

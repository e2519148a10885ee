"""Loops of cubic B-splines: from samples to coefficients, and slopes at the samples."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.kernels import compiled

_compiled = compiled(nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"})

POLE = np.sqrt(3.0) - 2.0  # of the filter from samples to coefficients
HORIZON = 30  # samples after which the pole's memory is 1e-17


@_compiled
def coefficients(image: FloatArray) -> FloatArray:
    """Cubic B-spline coefficients of an image mirrored about its border pixels.

    Unser, Aldroubi and Eden, IEEE Trans. Signal Process. 41 (1993) 821: along each axis a causal
    and an anticausal recursion with the pole √3 − 2.

    Args:
        image: samples without gaps, shape (rows, cols).
    """
    rows, cols = image.shape
    c = 36.0 * image if rows > 1 and cols > 1 else 6.0 * image if rows * cols > 1 else 1.0 * image
    if rows > 1:
        first = np.zeros(cols)
        for k in range(_reach(rows)):
            weight = POLE**k
            for j in range(cols):
                first[j] += weight * c[_mirrored(k, rows), j]
        first *= _closure(rows)
        c[0] = first
        for i in range(1, rows):
            for j in range(cols):
                c[i, j] += POLE * c[i - 1, j]
        scale = POLE / (POLE * POLE - 1.0)
        for j in range(cols):
            c[rows - 1, j] = scale * (c[rows - 1, j] + POLE * c[rows - 2, j])
        for i in range(rows - 2, -1, -1):
            for j in range(cols):
                c[i, j] = POLE * (c[i + 1, j] - c[i, j])
    if cols > 1:
        scale = POLE / (POLE * POLE - 1.0)
        for i in range(rows):
            total = 0.0
            for k in range(_reach(cols)):
                total += POLE**k * c[i, _mirrored(k, cols)]
            c[i, 0] = total * _closure(cols)
        # Rows side by side: one recursion alone would wait for its own last result.
        for i in range(0, rows, 4):
            some = min(4, rows - i)
            for j in range(1, cols):
                for k in range(some):
                    c[i + k, j] += POLE * c[i + k, j - 1]
            for k in range(some):
                last = c[i + k, cols - 1] + POLE * c[i + k, cols - 2]
                c[i + k, cols - 1] = scale * last
            for j in range(cols - 2, -1, -1):
                for k in range(some):
                    c[i + k, j] = POLE * (c[i + k, j + 1] - c[i + k, j])
    return c


@_compiled
def _reach(n: int) -> int:
    """Count the samples of the first causal value: a whole period if that is short."""
    return min(HORIZON, 2 * n - 2)


@_compiled
def _closure(n: int) -> float:
    """Return what the periods beyond the first add."""
    return 1.0 / (1.0 - POLE ** (2 * n - 2)) if 2 * n - 2 < HORIZON else 1.0


@_compiled
def _mirrored(k: int, n: int) -> int:
    return k if k < n else 2 * n - 2 - k


@_compiled
def slopes_at(c: FloatArray, rows: IntArray, cols: IntArray) -> FloatArray:
    """∂/∂row, ∂/∂col at whole pixels of an image from its coefficients, shape (n, 2) [1/px].

    At a knot the cubic spline's slope is (c₊ − c₋)/2 along one axis, smoothed by (1, 4, 1)/6
    along the other.

    Args:
        c: coefficients, mirrored about the border, shape (n_rows, n_cols).
        rows: row of each pixel, (n,).
        cols: its column.
    """
    n_rows, n_cols = c.shape
    slopes = np.empty((len(rows), 2))
    for k in range(len(rows)):
        r, q = rows[k], cols[k]
        up, down = _beside(r - 1, n_rows), _beside(r + 1, n_rows)
        left, right = _beside(q - 1, n_cols), _beside(q + 1, n_cols)
        corners = c[down, left] - c[up, left] + c[down, right] - c[up, right]
        slopes[k, 0] = (corners + 4.0 * (c[down, q] - c[up, q])) / 12.0
        corners = c[up, right] - c[up, left] + c[down, right] - c[down, left]
        slopes[k, 1] = (corners + 4.0 * (c[r, right] - c[r, left])) / 12.0
    return slopes


@_compiled
def _beside(k: int, n: int) -> int:
    if n == 1:
        return 0
    return abs(k) if k < n else 2 * n - 2 - k

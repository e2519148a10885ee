"""Tensors along several directions at once, inside the workspace of a point.

A tensor is stored component first: component i of direction m at `offset + width·i + m`. The
loops over directions vectorise; a single tensor is the case of width 1.
"""

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.law import P_C11, P_C12, P_C44
from solver_adapters.kernels import kernel

NM = 8  # modes of a tensor without trace, in the order of `law.SLIP_MODES`
_R2, _R6 = 1 / np.sqrt(2.0), 1 / np.sqrt(6.0)


@kernel
def left(w: FloatArray, c: int, a: int, turn_a: bool, b: int, turn_b: bool, width: int) -> None:
    """Set c_m = a·b_m for each direction m, a or b transposed where asked."""
    row, column = (1, 3) if turn_a else (3, 1)
    a0, a1, a2 = w[a], w[a + column], w[a + 2 * column]
    a3, a4, a5 = w[a + row], w[a + 4], w[a + row + 2 * column]
    a6, a7, a8 = w[a + 2 * row], w[a + 2 * row + column], w[a + 8]
    row, column = (width, 3 * width) if turn_b else (3 * width, width)
    for m in range(width):
        b0, b1, b2 = w[b + m], w[b + column + m], w[b + 2 * column + m]
        b3, b4, b5 = w[b + row + m], w[b + 4 * width + m], w[b + row + 2 * column + m]
        b6, b7, b8 = w[b + 2 * row + m], w[b + 2 * row + column + m], w[b + 8 * width + m]
        w[c + m] = a0 * b0 + a1 * b3 + a2 * b6
        w[c + width + m] = a0 * b1 + a1 * b4 + a2 * b7
        w[c + 2 * width + m] = a0 * b2 + a1 * b5 + a2 * b8
        w[c + 3 * width + m] = a3 * b0 + a4 * b3 + a5 * b6
        w[c + 4 * width + m] = a3 * b1 + a4 * b4 + a5 * b7
        w[c + 5 * width + m] = a3 * b2 + a4 * b5 + a5 * b8
        w[c + 6 * width + m] = a6 * b0 + a7 * b3 + a8 * b6
        w[c + 7 * width + m] = a6 * b1 + a7 * b4 + a8 * b7
        w[c + 8 * width + m] = a6 * b2 + a7 * b5 + a8 * b8


@kernel
def right(w: FloatArray, c: int, b: int, turn_b: bool, a: int, turn_a: bool, width: int) -> None:
    """Set c_m = b_m·a for each direction m, a or b transposed where asked."""
    row, column = (1, 3) if turn_a else (3, 1)
    a0, a1, a2 = w[a], w[a + column], w[a + 2 * column]
    a3, a4, a5 = w[a + row], w[a + 4], w[a + row + 2 * column]
    a6, a7, a8 = w[a + 2 * row], w[a + 2 * row + column], w[a + 8]
    row, column = (width, 3 * width) if turn_b else (3 * width, width)
    for m in range(width):
        b0, b1, b2 = w[b + m], w[b + column + m], w[b + 2 * column + m]
        b3, b4, b5 = w[b + row + m], w[b + 4 * width + m], w[b + row + 2 * column + m]
        b6, b7, b8 = w[b + 2 * row + m], w[b + 2 * row + column + m], w[b + 8 * width + m]
        w[c + m] = b0 * a0 + b1 * a3 + b2 * a6
        w[c + width + m] = b0 * a1 + b1 * a4 + b2 * a7
        w[c + 2 * width + m] = b0 * a2 + b1 * a5 + b2 * a8
        w[c + 3 * width + m] = b3 * a0 + b4 * a3 + b5 * a6
        w[c + 4 * width + m] = b3 * a1 + b4 * a4 + b5 * a7
        w[c + 5 * width + m] = b3 * a2 + b4 * a5 + b5 * a8
        w[c + 6 * width + m] = b6 * a0 + b7 * a3 + b8 * a6
        w[c + 7 * width + m] = b6 * a1 + b7 * a4 + b8 * a7
        w[c + 8 * width + m] = b6 * a2 + b7 * a5 + b8 * a8


@kernel
def add(w: FloatArray, a: int, b: int, factor: float, width: int) -> None:
    """Add factor times the tensors b to the tensors a."""
    for i in range(9 * width):
        w[a + i] += factor * w[b + i]


@kernel
def to_modes(w: FloatArray, c: int, a: int, width: int) -> None:
    """Write the eight modes of tensors."""
    for m in range(width):
        x, y, z = w[a + m], w[a + 4 * width + m], w[a + 8 * width + m]
        w[c + m] = _R2 * (x - y)
        w[c + width + m] = _R6 * (2.0 * z - x - y)
        w[c + 2 * width + m] = _R2 * (w[a + 5 * width + m] + w[a + 7 * width + m])
        w[c + 3 * width + m] = _R2 * (w[a + 2 * width + m] + w[a + 6 * width + m])
        w[c + 4 * width + m] = _R2 * (w[a + width + m] + w[a + 3 * width + m])
        w[c + 5 * width + m] = _R2 * (w[a + 5 * width + m] - w[a + 7 * width + m])
        w[c + 6 * width + m] = _R2 * (w[a + 2 * width + m] - w[a + 6 * width + m])
        w[c + 7 * width + m] = _R2 * (w[a + width + m] - w[a + 3 * width + m])


@kernel
def to_tensors(w: FloatArray, c: int, a: int, width: int) -> None:
    """Write the tensors of eight modes."""
    for m in range(width):
        x, y = _R2 * w[a + m], _R6 * w[a + width + m]
        w[c + m] = x - y
        w[c + 4 * width + m] = -x - y
        w[c + 8 * width + m] = 2.0 * y
        w[c + 5 * width + m] = _R2 * (w[a + 2 * width + m] + w[a + 5 * width + m])
        w[c + 7 * width + m] = _R2 * (w[a + 2 * width + m] - w[a + 5 * width + m])
        w[c + 2 * width + m] = _R2 * (w[a + 3 * width + m] + w[a + 6 * width + m])
        w[c + 6 * width + m] = _R2 * (w[a + 3 * width + m] - w[a + 6 * width + m])
        w[c + width + m] = _R2 * (w[a + 4 * width + m] + w[a + 7 * width + m])
        w[c + 3 * width + m] = _R2 * (w[a + 4 * width + m] - w[a + 7 * width + m])


@kernel
def cubic(w: FloatArray, s: int, e: int, p: FloatArray, width: int) -> None:
    """S = C : sym(e)."""
    difference, C12, C44 = p[P_C11] - p[P_C12], p[P_C12], p[P_C44]
    for m in range(width):
        x, y, z = w[e + m], w[e + 4 * width + m], w[e + 8 * width + m]
        volume = C12 * (x + y + z)
        xy = C44 * (w[e + width + m] + w[e + 3 * width + m])
        xz = C44 * (w[e + 2 * width + m] + w[e + 6 * width + m])
        yz = C44 * (w[e + 5 * width + m] + w[e + 7 * width + m])
        w[s + m] = difference * x + volume
        w[s + width + m] = xy
        w[s + 2 * width + m] = xz
        w[s + 3 * width + m] = xy
        w[s + 4 * width + m] = difference * y + volume
        w[s + 5 * width + m] = yz
        w[s + 6 * width + m] = xz
        w[s + 7 * width + m] = yz
        w[s + 8 * width + m] = difference * z + volume


@kernel
def over_modes(w: FloatArray, c: int, a: int, b: int, width: int) -> None:
    """Matrix (8 × 8) times modes: c_im = Σ_k a_ik b_km."""
    for i in range(NM):
        r = a + NM * i
        a0, a1, a2, a3 = w[r], w[r + 1], w[r + 2], w[r + 3]
        a4, a5, a6, a7 = w[r + 4], w[r + 5], w[r + 6], w[r + 7]
        for m in range(width):
            w[c + width * i + m] = (
                a0 * w[b + m]
                + a1 * w[b + width + m]
                + a2 * w[b + 2 * width + m]
                + a3 * w[b + 3 * width + m]
                + a4 * w[b + 4 * width + m]
                + a5 * w[b + 5 * width + m]
                + a6 * w[b + 6 * width + m]
                + a7 * w[b + 7 * width + m]
            )


@kernel
def determinant_of(w: FloatArray, a: int) -> float:
    """Return the determinant of the single tensor at a."""
    determinant: float = (
        w[a] * (w[a + 4] * w[a + 8] - w[a + 5] * w[a + 7])
        - w[a + 1] * (w[a + 3] * w[a + 8] - w[a + 5] * w[a + 6])
        + w[a + 2] * (w[a + 3] * w[a + 7] - w[a + 4] * w[a + 6])
    )
    return determinant


@kernel
def cofactor(w: FloatArray, c: int, a: int) -> None:
    """Cofactors of the single tensor at a: the derivative of its determinant."""
    for i in range(3):
        i1, i2 = (i + 1) % 3, (i + 2) % 3
        for j in range(3):
            j1, j2 = (j + 1) % 3, (j + 2) % 3
            w[c + 3 * i + j] = (
                w[a + 3 * i1 + j1] * w[a + 3 * i2 + j2] - w[a + 3 * i1 + j2] * w[a + 3 * i2 + j1]
            )

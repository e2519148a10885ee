"""Numbers along many directions at once, in a workspace beside that of the point.

A quantity of a block of directions is a row of `LANES` numbers, of which the first `width` count;
row i of several stands at `offset + LANES·i`. All directions meet the same coefficients, which
stand in the workspace of the point: loops over directions vectorise, and a system at rest, which
no direction moves, is passed over for all of them.
"""

from meshes.arrays import FloatArray
from solver_adapters.kernels import kernel

from . import NS

LANES = 64

# Rows of the moving systems, one after the other; what stands for a system at rest is unused.
B_EXPLICIT = 0  # derivative of the residual at fixed Δp
B_STEP = B_EXPLICIT + NS * LANES  # change of the slips
B_OVER = B_STEP + NS * LANES  # derivative of v at fixed Δp
B_FACTOR = B_OVER + NS * LANES  # derivative of the factor on τ0, 1
B_SLIP_END = B_FACTOR + LANES


@kernel
def bounded(number: int) -> int:
    """Return a number from 0 to 65535, as it is, in a form that tells LLVM so.

    An index that may be negative could count from the end, which keeps a loop from vectorising.
    """
    seen: int = number & 0xFFFF
    return seen


@kernel
def clear(b: FloatArray, target: int, rows: int, width: int) -> None:
    """Set rows to 0."""
    target, width = bounded(target), bounded(width)
    for i in range(rows):
        t = target + LANES * i
        for m in range(width):
            b[t + m] = 0.0


@kernel
def fetch(
    b: FloatArray, target: int, rows: int, source: FloatArray, first: int, width: int
) -> None:
    """Copy the first rows of an array (n, k) from column `first` on."""
    target, first, width = bounded(target), bounded(first), bounded(width)
    for i in range(rows):
        t = target + LANES * i
        for m in range(width):
            b[t + m] = source[i, first + m]


@kernel
def store(
    b: FloatArray, source: int, rows: int, target: FloatArray, first: int, width: int
) -> None:
    """Copy rows to the first rows of an array (n, k) from column `first` on."""
    source, first, width = bounded(source), bounded(first), bounded(width)
    for i in range(rows):
        s = source + LANES * i
        for m in range(width):
            target[i, first + m] = b[s + m]


@kernel
def sum5(
    b: FloatArray, target: int, source: int, w: FloatArray, c: int, step: int, factor: float,
    width: int,
) -> None:  # fmt: skip
    """Add factor · Σ_j w[c + step·j] source_j over five rows to one row."""
    target, source, width = bounded(target), bounded(source), bounded(width)
    c0, c1, c2 = factor * w[c], factor * w[c + step], factor * w[c + 2 * step]
    c3, c4 = factor * w[c + 3 * step], factor * w[c + 4 * step]
    for m in range(width):
        b[target + m] += (
            c0 * b[source + m]
            + c1 * b[source + LANES + m]
            + c2 * b[source + 2 * LANES + m]
            + c3 * b[source + 3 * LANES + m]
            + c4 * b[source + 4 * LANES + m]
        )


@kernel
def sum8(
    b: FloatArray, target: int, source: int, w: FloatArray, c: int, step: int, factor: float,
    width: int,
) -> None:  # fmt: skip
    """Do the same over eight rows."""
    target, source, width = bounded(target), bounded(source), bounded(width)
    c0, c1, c2 = factor * w[c], factor * w[c + step], factor * w[c + 2 * step]
    c3, c4, c5 = factor * w[c + 3 * step], factor * w[c + 4 * step], factor * w[c + 5 * step]
    c6, c7 = factor * w[c + 6 * step], factor * w[c + 7 * step]
    for m in range(width):
        b[target + m] += (
            c0 * b[source + m]
            + c1 * b[source + LANES + m]
            + c2 * b[source + 2 * LANES + m]
            + c3 * b[source + 3 * LANES + m]
            + c4 * b[source + 4 * LANES + m]
            + c5 * b[source + 5 * LANES + m]
            + c6 * b[source + 6 * LANES + m]
            + c7 * b[source + 7 * LANES + m]
        )


@kernel
def sum9(
    b: FloatArray, target: int, source: int, w: FloatArray, c: int, step: int, width: int
) -> None:
    """Do the same over nine rows, with factor 1."""
    sum8(b, target, source, w, c, step, 1.0, width)
    add(b, target, source + 8 * LANES, w[c + 8 * step], 1, width)


@kernel
def left(
    b: FloatArray, c: int, w: FloatArray, a: int, source: int, turned: bool, width: int
) -> None:
    """Set the tensors c = a·source, a one tensor of the point, source transposed where asked."""
    c, source, width = bounded(c), bounded(source), bounded(width)
    row, column = (LANES, 3 * LANES) if turned else (3 * LANES, LANES)
    for i in range(3):
        a0, a1, a2 = w[a + 3 * i], w[a + 3 * i + 1], w[a + 3 * i + 2]
        for j in range(3):
            t, s = c + LANES * (3 * i + j), source + column * j
            for m in range(width):
                b[t + m] = a0 * b[s + m] + a1 * b[s + row + m] + a2 * b[s + 2 * row + m]


@kernel
def right(
    b: FloatArray, c: int, source: int, w: FloatArray, a: int, turn_a: bool, width: int
) -> None:
    """Set the tensors c = source·a, a one tensor of the point, transposed where asked."""
    c, source, width = bounded(c), bounded(source), bounded(width)
    row, column = (1, 3) if turn_a else (3, 1)
    for j in range(3):
        at = a + column * j
        a0, a1, a2 = w[at], w[at + row], w[at + 2 * row]
        for i in range(3):
            t, s = c + LANES * (3 * i + j), source + 3 * LANES * i
            for m in range(width):
                b[t + m] = a0 * b[s + m] + a1 * b[s + LANES + m] + a2 * b[s + 2 * LANES + m]


@kernel
def add(b: FloatArray, target: int, source: int, factor: float, rows: int, width: int) -> None:
    """Add rows, times a factor, to others."""
    target, source, width = bounded(target), bounded(source), bounded(width)
    for i in range(rows):
        t, s = target + LANES * i, source + LANES * i
        for m in range(width):
            b[t + m] += factor * b[s + m]

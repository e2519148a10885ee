"""Small dense systems inside the workspace of a point: LU factors without pivoting."""

from meshes.arrays import FloatArray
from solver_adapters.kernels import kernel


@kernel
def factor(w: FloatArray, a: int, n: int) -> None:
    """Replace the matrix (n, n) at a by its factors L and U, the pivots inverted."""
    for k in range(n):
        inverse = 1.0 / w[a + (n + 1) * k]
        w[a + (n + 1) * k] = inverse
        for i in range(k + 1, n):
            ratio = w[a + n * i + k] * inverse
            w[a + n * i + k] = ratio
            for j in range(k + 1, n):
                w[a + n * i + j] -= ratio * w[a + n * k + j]


@kernel
def solve(w: FloatArray, a: int, n: int, b: int, width: int) -> None:
    """Solve for the right-hand sides (n, width) at b, in place."""
    for i in range(n):
        for k in range(i):
            ratio = w[a + n * i + k]
            for m in range(width):
                w[b + width * i + m] -= ratio * w[b + width * k + m]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            ratio = w[a + n * i + k]
            for m in range(width):
                w[b + width * i + m] -= ratio * w[b + width * k + m]
        inverse = w[a + (n + 1) * i]
        for m in range(width):
            w[b + width * i + m] *= inverse


@kernel
def solve_five(w: FloatArray, a: int, b: int, width: int) -> None:
    """Do as `solve` for n = 5 and many right-hand sides.

    All of a column is done in one body: LLVM vectorises the loop over columns then.
    """
    d0, d1, d2, d3, d4 = w[a], w[a + 6], w[a + 12], w[a + 18], w[a + 24]
    l10, l20, l30, l40 = w[a + 5], w[a + 10], w[a + 15], w[a + 20]
    l21, l31, l41, l32, l42, l43 = w[a + 11], w[a + 16], w[a + 21], w[a + 17], w[a + 22], w[a + 23]
    u01, u02, u03, u04 = w[a + 1], w[a + 2], w[a + 3], w[a + 4]
    u12, u13, u14, u23, u24, u34 = w[a + 7], w[a + 8], w[a + 9], w[a + 13], w[a + 14], w[a + 19]
    for m in range(width):
        x0 = w[b + m]
        x1 = w[b + width + m] - l10 * x0
        x2 = w[b + 2 * width + m] - l20 * x0 - l21 * x1
        x3 = w[b + 3 * width + m] - l30 * x0 - l31 * x1 - l32 * x2
        x4 = w[b + 4 * width + m] - l40 * x0 - l41 * x1 - l42 * x2 - l43 * x3
        x4 = d4 * x4
        x3 = d3 * (x3 - u34 * x4)
        x2 = d2 * (x2 - u24 * x4 - u23 * x3)
        x1 = d1 * (x1 - u14 * x4 - u13 * x3 - u12 * x2)
        x0 = d0 * (x0 - u04 * x4 - u03 * x3 - u02 * x2 - u01 * x1)
        w[b + m] = x0
        w[b + width + m] = x1
        w[b + 2 * width + m] = x2
        w[b + 3 * width + m] = x3
        w[b + 4 * width + m] = x4

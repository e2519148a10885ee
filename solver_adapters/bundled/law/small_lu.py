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

from __future__ import annotations

import numpy as np
import pytest

from solver_adapters.bundled.law import small_lu
from tests.solver_adapters.bundled.from_python import FromPython

kernels = FromPython(small_lu)


@pytest.mark.parametrize(
    ("solve", "n", "width"),
    [("solve", 5, 1), ("solve", 8, 9), ("solve_five", 5, 9)],
)
def test_a_factored_matrix_solves_all_right_hand_sides_in_place(
    solve: str, n: int, width: int
) -> None:
    rng = np.random.default_rng(0)
    matrix = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    rhs = rng.normal(size=(n, width))
    workspace = np.concatenate([np.full(3, np.nan), matrix.ravel(), rhs.ravel()])
    kernels.factor(workspace, 3, n)
    sizes = (n,) if solve == "solve" else ()
    getattr(kernels, solve)(workspace, 3, *sizes, 3 + n * n, width)
    found = workspace[3 + n * n :].reshape(n, width)
    np.testing.assert_allclose(found, np.linalg.solve(matrix, rhs), atol=1e-13)
    assert np.isnan(workspace[:3]).all()

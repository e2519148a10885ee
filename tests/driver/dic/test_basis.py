from __future__ import annotations

import numpy as np
import pytest

from driver.dic.basis import grid_basis

BOUNDS = (-2.0, 2.0, 0.0, 12.0)


def test_the_grid_fills_the_bounds_with_elements_near_the_wanted_size() -> None:
    basis = grid_basis(np.zeros((1, 2)), BOUNDS, 1.76)
    assert basis.cells == (2, 7)
    assert basis.nodes.shape == (24, 2)
    assert basis.nodes.min(axis=0).tolist() == [-2.0, 0.0]
    assert basis.nodes.max(axis=0).tolist() == [2.0, 12.0]


def test_bilinear_fields_are_reproduced_at_pixels_and_anywhere() -> None:
    xy = np.random.default_rng(12).uniform((-2, 0), (2, 12), (300, 2))
    basis = grid_basis(xy, BOUNDS, 0.9)

    def field(p: np.ndarray) -> np.ndarray:
        return np.asarray(0.3 - 1.2 * p[:, 0] + 0.7 * p[:, 1] + 0.2 * p[:, 0] * p[:, 1])

    assert basis.values @ field(basis.nodes) == pytest.approx(field(xy), abs=1e-12)
    corners = np.array([[-2.0, 0.0], [2.0, 12.0], [0.1, 12.0]])
    assert basis.at(corners) @ field(basis.nodes) == pytest.approx(field(corners), abs=1e-12)


def test_each_function_is_one_at_its_own_node_only() -> None:
    basis = grid_basis(np.zeros((1, 2)), BOUNDS, 2.0)
    assert basis.at(basis.nodes).toarray() == pytest.approx(np.eye(len(basis.nodes)), abs=1e-12)


def test_a_point_off_the_grid_is_refused() -> None:
    with pytest.raises(ValueError, match="outside the bounds"):
        grid_basis(np.array([[0.0, 12.5]]), BOUNDS, 1.0)

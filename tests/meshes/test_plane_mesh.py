from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from meshes.arrays import FloatArray
from meshes.plane_cells import CELLS, CellKind
from meshes.plane_mesh import PlaneMesh
from tests.meshes.plane_examples import distorted

KINDS: list[CellKind] = ["tri3", "tri6", "quad4", "quad8"]


@pytest.mark.parametrize("kind", KINDS)
def test_each_function_is_one_at_its_node_and_all_sum_to_one(kind: CellKind) -> None:
    cell = CELLS[kind]
    assert cell.shape(cell.nodes) == pytest.approx(np.eye(cell.n_nodes), abs=1e-15)
    at = np.random.default_rng(0).uniform(0, 0.5, (20, 2))
    assert cell.shape(at).sum(axis=1) == pytest.approx(1.0, abs=1e-14)
    assert cell.gradient(at).sum(axis=1) == pytest.approx(0.0, abs=1e-14)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_agree_with_differences(kind: CellKind) -> None:
    cell, h = CELLS[kind], 1e-6
    at = np.random.default_rng(1).uniform(0, 0.5, (10, 2))
    for axis, step in enumerate(np.eye(2) * h):
        difference = (cell.shape(at + step) - cell.shape(at - step)) / (2 * h)
        assert cell.gradient(at)[..., axis] == pytest.approx(difference, abs=1e-9)


@pytest.mark.parametrize("kind", KINDS)
def test_affine_fields_pass_the_patch_test_and_quadratic_ones_where_the_mesh_is_straight(
    kind: CellKind,
) -> None:
    mesh = distorted(kind)
    xy = np.random.default_rng(2).uniform(0.05, 2.95, (500, 2))
    cell, local = mesh.locate(xy)
    assert (cell >= 0).all()
    matrix = mesh.interpolation(cell, local)

    def affine(p: FloatArray) -> FloatArray:
        return np.asarray(0.3 - 1.2 * p[:, 0] + 0.7 * p[:, 1])

    def quadratic(p: FloatArray) -> FloatArray:
        return np.asarray(affine(p) + 0.4 * p[:, 0] ** 2 - 0.9 * p[:, 0] * p[:, 1] + p[:, 1] ** 2)

    assert matrix @ affine(mesh.points) == pytest.approx(affine(xy), abs=1e-12)
    error = np.abs(matrix @ quadratic(mesh.points) - quadratic(xy)).max()
    # Straight sides: tri6 is affine. A distorted quad8 holds quadratics only where its map is
    # affine (Zienkiewicz & Taylor, The Finite Element Method, isoparametric elements).
    if kind == "tri6":
        assert error < 1e-12
    elif kind == "quad8":
        square = distorted(kind, by=0.0)
        matrix = square.interpolation(*square.locate(xy))
        assert matrix @ quadratic(square.points) == pytest.approx(quadratic(xy), abs=1e-12)
    else:
        assert error > 1e-3


def test_points_outside_are_told_from_those_on_the_border() -> None:
    mesh = distorted("quad4")
    cell, _ = mesh.locate(np.array([[0.0, 0.0], [3.0, 1.5], [3.001, 1.5], [-1.0, 5.0]]))
    assert (cell >= 0).tolist() == [True, True, False, False]


POINTS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
CELL = np.array([[0, 1, 2]])


@pytest.mark.parametrize(
    ("points", "cells", "kind", "said"),
    [
        (POINTS, CELL, "tri4", "one of tri3, tri6"),
        (POINTS, CELL, "quad4", r"quad4 cells are \(n_cells, 4\)"),
        (POINTS, CELL + 1, "tri3", "the mesh has 3 points"),
        (POINTS * np.nan, CELL, "tri3", "finite X, Y"),
        (POINTS * [1, 0], CELL, "tri3", "cell 0 is folded or flat"),
        (np.vstack([POINTS, [5, 5]]), CELL, "tri3", "node 3 belongs to no cell"),
    ],
)
def test_a_broken_mesh_is_refused_in_one_sentence(
    points: FloatArray, cells: NDArray[np.int64], kind: CellKind, said: str
) -> None:
    with pytest.raises(ValueError, match=said):
        PlaneMesh(points, cells, kind).check()

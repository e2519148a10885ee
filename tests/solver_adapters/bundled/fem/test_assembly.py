"""The compiled kernels and the pattern against dense sums, for each element."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
import scipy.sparse as sp

from meshes.arrays import FloatArray, IntArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.bundled.fem import assembly
from solver_adapters.bundled.fem.element import element_of, shape_gradients
from tools.boxes import BOXES

RNG = np.random.default_rng(5)


@dataclass(frozen=True, eq=False)
class Discrete:
    """A mesh with its gradients and weights."""

    mesh: PrismMesh
    gradients: FloatArray
    weights: FloatArray

    @cached_property
    def dofs(self) -> IntArray:
        return (3 * self.mesh.cells[:, :, None] + np.arange(3)).reshape(len(self.mesh.cells), -1)

    @property
    def n_nodes(self) -> int:
        return len(self.mesh.points)

    def dense(self, C: FloatArray) -> FloatArray:
        n_cells, n = self.dofs.shape
        tangents = C.reshape(*self.weights.shape, 3, 3, 3, 3)
        blocks = np.einsum(
            "eq,eqaj,eqijkl,eqbl->eaibk", self.weights, self.gradients, tangents, self.gradients
        ).reshape(n_cells, n, n)
        dense = np.zeros((3 * self.n_nodes, 3 * self.n_nodes))
        for dofs, block in zip(self.dofs, blocks, strict=True):
            dense[np.ix_(dofs, dofs)] += block
        return dense

    def stiffness(self, C: FloatArray, part: int = 0) -> FloatArray:
        n = self.dofs.shape[1]
        K = np.empty((len(self.mesh.cells), n * (n + 1) // 2))
        assembly.element_stiffness(C, self.gradients, self.weights, K, part)
        return K


def test_the_indices_of_a_pattern_take_four_bytes() -> None:
    mesh = BOXES["hex20"]()
    pattern = assembly.stiffness_pattern(mesh.cells, np.zeros(3 * len(mesh.points), bool))
    for indices in (pattern.indptr, pattern.indices, pattern.slots):
        assert indices.itemsize == 4


@pytest.fixture(scope="module", params=list(BOXES))
def discrete(request: pytest.FixtureRequest) -> Discrete:
    mesh = BOXES[request.param]()
    return Discrete(mesh, *shape_gradients(mesh.points, mesh.cells, element_of(mesh.cells)))


def test_the_stored_lower_triangle_is_the_stiffness_on_the_free_degrees_of_freedom(
    discrete: Discrete,
) -> None:
    C = RNG.normal(size=(discrete.weights.size, 9, 9))
    C = C + C.transpose(0, 2, 1)
    prescribed = RNG.random(3 * discrete.n_nodes) < 0.3
    pattern = assembly.stiffness_pattern(discrete.mesh.cells, prescribed)
    values = pattern.values(discrete.stiffness(C))
    free = len(pattern.free)
    found = sp.csc_array((values, pattern.indices, pattern.indptr), shape=(free, free))
    expected = np.tril(discrete.dense(C)[np.ix_(pattern.free, pattern.free)])
    np.testing.assert_allclose(found.toarray(), expected, atol=1e-11)
    assert found.has_sorted_indices
    np.testing.assert_array_equal(pattern.free, np.flatnonzero(~prescribed))


def test_symmetric_and_antisymmetric_parts_are_those_of_the_dense_stiffness(
    discrete: Discrete,
) -> None:
    C = RNG.normal(size=(discrete.weights.size, 9, 9))
    prescribed = RNG.random(3 * discrete.n_nodes) < 0.3
    pattern = assembly.stiffness_pattern(discrete.mesh.cells, prescribed)
    values = {
        1: pattern.values(discrete.stiffness(C, part=1)),
        -1: pattern.antisymmetric_values(discrete.stiffness(C, part=-1)),
    }
    dense = discrete.dense(C)[np.ix_(pattern.free, pattern.free)]
    for part in (1, -1):
        found = sp.csc_array((values[part], pattern.indices, pattern.indptr), shape=dense.shape)
        expected = np.tril(dense + part * dense.T) / 2
        np.testing.assert_allclose(found.toarray(), expected, atol=1e-11)
    assert not values[-1][pattern.indptr[:-1]].any()  # nothing on the diagonal


def test_gradients_and_forces_are_transposes_of_each_other(discrete: Discrete) -> None:
    """Virtual work: forces of a stress P do the same work on u as P on the gradient of u."""
    cells, n_points = discrete.mesh.cells, discrete.weights.size
    u, P = RNG.normal(size=(discrete.n_nodes, 3)), RNG.normal(size=(n_points, 9))
    H, forces = np.empty((n_points, 9)), np.empty(discrete.dofs.shape)
    assembly.displacement_gradients(u, cells, discrete.gradients, H)
    assembly.element_forces(P, discrete.gradients, discrete.weights, forces)
    work = np.sum(discrete.weights.ravel() * (P * H).sum(axis=1))
    np.testing.assert_allclose(np.sum(forces * u.ravel()[discrete.dofs]), work, rtol=1e-11)
    expected = np.einsum("eai,eqaj->eqij", u[cells], discrete.gradients)
    np.testing.assert_allclose(H, expected.reshape(-1, 9), atol=1e-13)


def test_changes_of_the_gradients_are_added_to_their_directions_where_they_are_not_null(
    discrete: Discrete,
) -> None:
    """Three directions of which two change the gradients, one of them in one half alone."""
    cells, n_points = discrete.mesh.cells, discrete.weights.size
    u, P = RNG.normal(size=(discrete.n_nodes, 3)), RNG.normal(size=(n_points, 9))
    changes = RNG.normal(size=(2, *discrete.gradients.shape))
    changes[1, : len(cells) // 2] = 0.0
    changed, where = abs(changes).max(axis=(2, 3, 4)) > 0.0, np.array([2, 0])
    assert 0 < np.count_nonzero(changed[1]) < len(cells)
    H, forces = RNG.normal(size=(n_points, 9, 3)), RNG.normal(size=(*discrete.dofs.shape, 3))
    before, at_rest = H.copy(), forces.copy()
    assembly.add_gradient_changes(u, cells, changes, changed, where, H)
    assembly.add_force_changes(P, changes, changed, where, forces)
    stress = P.reshape(*discrete.weights.shape, 3, 3)
    for change, k in zip(changes, where, strict=True):
        before[:, :, k] += np.einsum("eai,eqaj->eqij", u[cells], change).reshape(-1, 9)
        added = np.einsum("eqij,eqaj->eai", stress, change)
        at_rest[:, :, k] += added.reshape(len(cells), -1)
    np.testing.assert_allclose(H, before, atol=1e-12)
    np.testing.assert_allclose(forces, at_rest, atol=1e-11)


def test_several_directions_are_the_single_ones_side_by_side(discrete: Discrete) -> None:
    cells, n_nodes, n_points = discrete.mesh.cells, discrete.n_nodes, discrete.weights.size
    u, P = RNG.normal(size=(n_nodes, 3, 4)), RNG.normal(size=(n_points, 9, 4))
    H, forces = np.empty((n_points, 9, 4)), np.empty((*discrete.dofs.shape, 4))
    assembly.direction_gradients(u, cells, discrete.gradients, H)
    assembly.direction_forces(P, discrete.gradients, discrete.weights, forces)
    pattern = assembly.stiffness_pattern(cells, np.zeros(3 * n_nodes, dtype=np.bool_))
    sums = pattern.node_sums(forces, n_nodes)
    for k in range(4):
        one, force = np.empty((n_points, 9)), np.empty(discrete.dofs.shape)
        assembly.displacement_gradients(u[:, :, k].copy(), cells, discrete.gradients, one)
        np.testing.assert_allclose(H[:, :, k], one, atol=1e-13)
        assembly.element_forces(P[:, :, k].copy(), discrete.gradients, discrete.weights, force)
        expected = np.zeros(3 * n_nodes)
        np.add.at(expected, discrete.dofs, force)
        np.testing.assert_allclose(sums[:, k], expected, atol=1e-12)
        np.testing.assert_allclose(pattern.node_sum(force, n_nodes), expected, atol=1e-12)

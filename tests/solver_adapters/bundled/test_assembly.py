from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from solver_adapters.bundled import assembly
from solver_adapters.bundled.element import shape_gradients
from tests.solver_adapters.boxes import box

MESH = box()
N_NODES, N_CELLS = len(MESH.points), len(MESH.cells)
RNG = np.random.default_rng(5)
GRADIENTS, WEIGHTS = shape_gradients(MESH.points, MESH.cells)
DOFS = (3 * MESH.cells[:, :, None] + np.arange(3)).reshape(N_CELLS, 30)


def _symmetric_tangents() -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    C = RNG.normal(size=(4 * N_CELLS, 9, 9))
    return C + C.transpose(0, 2, 1)


def test_the_stored_lower_triangle_is_the_stiffness_on_the_free_degrees_of_freedom() -> None:
    C = _symmetric_tangents()
    prescribed = RNG.random(3 * N_NODES) < 0.3
    pattern = assembly.stiffness_pattern(MESH.cells, prescribed)
    K = np.empty((N_CELLS, 465))
    assembly.element_stiffness(C, GRADIENTS, WEIGHTS, K)
    free = len(pattern.free)
    found = sp.csc_array((pattern.values(K), pattern.indices, pattern.indptr), shape=(free, free))

    blocks = np.einsum(
        "eq,eqaj,eqijkl,eqbl->eaibk",
        WEIGHTS,
        GRADIENTS,
        C.reshape(N_CELLS, 4, 3, 3, 3, 3),
        GRADIENTS,
    ).reshape(N_CELLS, 30, 30)
    dense = np.zeros((3 * N_NODES, 3 * N_NODES))
    for dofs, block in zip(DOFS, blocks, strict=True):
        dense[np.ix_(dofs, dofs)] += block
    expected = np.tril(dense[np.ix_(pattern.free, pattern.free)])
    np.testing.assert_allclose(found.toarray(), expected, atol=1e-11)
    assert found.has_sorted_indices
    np.testing.assert_array_equal(pattern.free, np.flatnonzero(~prescribed))


def test_gradients_and_forces_are_transposes_of_each_other() -> None:
    """Virtual work: forces of a stress P do the same work on u as P on the gradient of u."""
    u, P = RNG.normal(size=(N_NODES, 3)), RNG.normal(size=(4 * N_CELLS, 9))
    H, forces = np.empty((4 * N_CELLS, 9)), np.empty((N_CELLS, 30))
    assembly.displacement_gradients(u, MESH.cells, GRADIENTS, H)
    assembly.element_forces(P, GRADIENTS, WEIGHTS, forces)
    np.testing.assert_allclose(
        np.sum(forces * u.ravel()[DOFS]), np.sum(WEIGHTS.ravel() * (P * H).sum(axis=1)), rtol=1e-11
    )
    expected = np.einsum("eai,eqaj->eqij", u[MESH.cells], GRADIENTS)
    np.testing.assert_allclose(H, expected.reshape(-1, 9), atol=1e-13)


def test_several_directions_are_the_single_ones_side_by_side() -> None:
    u, P = RNG.normal(size=(N_NODES, 3, 4)), RNG.normal(size=(4 * N_CELLS, 4, 9))
    start = RNG.normal(size=(4 * N_CELLS, 4, 9))
    H, forces = start.copy(), np.empty((N_CELLS, 30, 4))
    assembly.direction_gradients(u, MESH.cells, GRADIENTS, H)
    assembly.direction_forces(P, GRADIENTS, WEIGHTS, forces)
    pattern = assembly.stiffness_pattern(MESH.cells, np.zeros(3 * N_NODES, dtype=np.bool_))
    sums = pattern.node_sums(forces, N_NODES)
    for k in range(4):
        one, force = np.empty((4 * N_CELLS, 9)), np.empty((N_CELLS, 30))
        assembly.displacement_gradients(u[:, :, k].copy(), MESH.cells, GRADIENTS, one)
        np.testing.assert_allclose(H[:, k], start[:, k] + one, atol=1e-13)
        assembly.element_forces(P[:, k].copy(), GRADIENTS, WEIGHTS, force)
        expected = np.zeros(3 * N_NODES)
        np.add.at(expected, DOFS, force)
        np.testing.assert_allclose(sums[:, k], expected, atol=1e-12)

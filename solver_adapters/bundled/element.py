"""The ten-node tetrahedron: shape gradients and weights at its four Gauss points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_A, _B = (5 + 3 * np.sqrt(5)) / 20, (5 - np.sqrt(5)) / 20
# Barycentric Gauss points of degree 2, each of weight 1/4 of the volume.
GAUSS = np.full((4, 4), _B) + (_A - _B) * np.eye(4)
# Corner pairs of the mid-edge nodes 4…9 (VTK order).
EDGES = ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3))


def reference_gradients(barycentric: FloatArray) -> FloatArray:
    """∂N_a/∂ξ_j of the ten shape functions, (n, 4) barycentric points → (n, 10, 3)."""
    corner = np.array([[-1.0, -1.0, -1.0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    gradients = np.empty((len(barycentric), 10, 3))
    for a in range(4):
        gradients[:, a] = (4 * barycentric[:, [a]] - 1) * corner[a]
    for a, (i, j) in enumerate(EDGES, start=4):
        gradients[:, a] = 4 * (barycentric[:, [i]] * corner[j] + barycentric[:, [j]] * corner[i])
    return gradients


def shape_gradients(points: FloatArray, cells: IntArray) -> tuple[FloatArray, FloatArray]:
    """Physical shape gradients [1/µm] and weights [µm³] at the Gauss points.

    Args:
        points: node coordinates [µm], (n_nodes, 3).
        cells: tet10 connectivity in VTK order, (n_cells, 10).

    Returns:
        gradients (n_cells, 4, 10, 3) and weights (n_cells, 4).

    Raises:
        ValueError: a cell is inverted.
    """
    reference = reference_gradients(GAUSS)
    jacobian = np.einsum("eai,qaj->eqij", points[cells], reference)
    determinant = np.linalg.det(jacobian)
    if determinant.min() <= 0:
        cell = int(np.argmin(determinant.min(axis=1)))
        raise ValueError(f"cell {cell} of the mesh is inverted (Jacobian ≤ 0)")
    gradients = np.einsum("qaj,eqji->eqai", reference, np.linalg.inv(jacobian))
    return np.ascontiguousarray(gradients), determinant / 24.0


def shape_gradient_velocity(
    gradients: FloatArray, weights: FloatArray, cells: IntArray, velocity: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Derivatives of `shape_gradients` when the nodes move with `velocity` (n_nodes, 3)."""
    spread = np.einsum("eai,eqaj->eqij", velocity[cells], gradients)
    return (
        -np.einsum("eqai,eqij->eqaj", gradients, spread),
        weights * np.trace(spread, axis1=2, axis2=3),
    )

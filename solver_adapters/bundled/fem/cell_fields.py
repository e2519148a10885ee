"""What the cells carry: stress, slips and lattice rotation, as means over their Gauss points.

With P the first Piola–Kirchhoff stress times the crystal rotation R and H = ∇u·R, as everywhere
in this package:

    small strain    σ = P·Rᵀ                       rotation = skew(∇u) − R (Σ γ skew(m⊗n)) Rᵀ
    finite strain   σ = P·(R + H)ᵀ / det(R + H)    rotation = Q(t)·Q(0)ᵀ, Fe = (R + H)·Fp⁻¹ = Q·U
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import Problem
from solver_adapters.bundled.fem.state import Instant

# XX, YY, ZZ, YZ, XZ, XY.
_ROW, _COLUMN = np.array([0, 1, 2, 1, 0, 0]), np.array([0, 1, 2, 2, 2, 1])


def widths(n_systems: int) -> dict[str, int]:
    """Return the number of components of each field of so many slip systems."""
    return {"stress": 6, "slip": n_systems, "accumulated_slip": n_systems, "rotation": 3}


def cell_fields(problem: Problem, start: Instant, instant: Instant) -> dict[str, FloatArray]:
    """Return the fields of `CellFields` at an instant, by name.

    Args:
        problem: the discrete problem.
        start: its state at the first instant, from which rotations count.
        instant: its state then; both with slips and stress.

    Returns:
        means over the undeformed volume of each cell, (n_cells, width).
    """
    points = problem.points
    rows = points.layout
    rotation = points.rotation[points.frame_of]
    if points.strain_measure == "finite":
        stress = finite_stress(instant.P, instant.H, rotation)
        before = lattice_axes(start.H, start.state[:, :9], rotation)
        turned = rotation_between(before, lattice_axes(instant.H, instant.state[:, :9], rotation))
    else:
        stress = small_stress(instant.P, rotation)
        slip = instant.slip - start.slip
        turned = small_rotation(instant.H - start.H, slip, rotation, points.systems.tensors)
    fields = {
        "stress": stress[:, _ROW, _COLUMN],
        "slip": instant.slip,
        "accumulated_slip": instant.state[:, rows.accumulated : rows.x2],
        "rotation": turned,
    }
    return {name: cell_means(values, problem.weights) for name, values in fields.items()}


def cell_means(values: FloatArray, weights: FloatArray) -> FloatArray:
    """Means (n_cells, k) of point values (n_points, k), weights (n_cells, n_gauss)."""
    by_cell = values.reshape(*weights.shape, -1)
    means: FloatArray = np.einsum("cg,cgk->ck", weights, by_cell) / weights.sum(axis=1)[:, None]
    return means


def small_stress(P: FloatArray, rotation: FloatArray) -> FloatArray:
    """Stress in the specimen frame [MPa], (n_points, 3, 3)."""
    stress: FloatArray = P.reshape(-1, 3, 3) @ np.swapaxes(rotation, 1, 2)
    return stress


def finite_stress(P: FloatArray, H: FloatArray, rotation: FloatArray) -> FloatArray:
    """Cauchy stress in the specimen frame [MPa], (n_points, 3, 3)."""
    F = rotation + H.reshape(-1, 3, 3)
    stress: FloatArray = P.reshape(-1, 3, 3) @ np.swapaxes(F, 1, 2)
    stress /= np.linalg.det(F)[:, None, None]
    return stress


def small_rotation(
    H: FloatArray, slip: FloatArray, rotation: FloatArray, schmid: FloatArray
) -> FloatArray:
    """Rotation vector of the lattice in the specimen frame [rad], (n_points, 3).

    Args:
        H: displacement gradient times the crystal rotation, (n_points, 9).
        slip: signed slip of each system, (n_points, n_systems).
        rotation: crystal → specimen rotation, (n_points, 3, 3).
        schmid: Schmid tensors in crystal axes, (n_systems, 3, 3).
    """
    slipped = np.einsum("ps,sij->pij", slip, schmid)
    # In the crystal on the right: what is left of the displacement gradient without slip.
    elastic = (H.reshape(-1, 3, 3) - rotation @ slipped) @ np.swapaxes(rotation, 1, 2)
    after, before = [2, 0, 1], [1, 2, 0]
    return np.asarray(0.5 * (elastic[:, after, before] - elastic[:, before, after]))


def lattice_axes(H: FloatArray, inverse_plastic: FloatArray, rotation: FloatArray) -> FloatArray:
    """Crystal → specimen rotation of the deformed lattice, (n_points, 3, 3)."""
    elastic = (rotation + H.reshape(-1, 3, 3)) @ inverse_plastic.reshape(-1, 3, 3)
    left, _, right = np.linalg.svd(elastic)
    axes: FloatArray = left @ right
    return axes


def rotation_between(before: FloatArray, after: FloatArray) -> FloatArray:
    """Rotation vectors [rad] that turn axes (n, 3, 3) into others, (n, 3)."""
    vectors: FloatArray = Rotation.from_matrix(after @ np.swapaxes(before, 1, 2)).as_rotvec()
    return vectors

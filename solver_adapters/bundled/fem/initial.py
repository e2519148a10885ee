"""State of the specimen before loading: back strain of prior cold work, eigenstrain.

Every function takes complex numbers: the imaginary part carries a derivative without cancellation
(complex step), which is how sensitivities start.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from meshes.arrays import AnyArray
from solver_adapters.bundled.law.law import STRAIN_MODES, StateLayout
from solver_adapters.crystal import SystemTable, slip_systems
from solver_adapters.interface import UnsupportedError
from solver_adapters.material import StrainMeasure

# Pairs of point and facet that are looked at in one go.
_PAIRS = 2_000_000
# Facets reach this share of their size beyond their edges, so that every point has one above it.
_EDGE = 1e-6

# Volume-preserving stretch along Y.
_AXIAL = np.diag([-0.5, 1.0, -0.5])


def initial_state(
    strain_measure: StrainMeasure,
    systems: SystemTable,
    x0: Any,
    eigenstrain: Any,
    rotation: AnyArray,
    depth: AnyArray,
    second: bool = True,
) -> AnyArray:
    """State of the Gauss points at rest.

    The eigenstrain is prior plastic strain: in finite strain Fp⁻¹ = I − E scaled to unit
    determinant, in small strain ep = E.

    Args:
        strain_measure: "small" or "finite".
        systems: the slip systems.
        x0: back strain of a system whose Schmid factor along Y is 1/2, see `Material`.
        eigenstrain: difference over the depth, see `Material`.
        rotation: crystal → specimen rotation of each point, (n_points, 3, 3).
        depth: how deep each point lies, in shares of the depth from the mean, (n_points,).
        second: whether the second back strains are carried.

    Returns:
        (n_points, n_state) as of `law.StateLayout`, complex where an argument is.
    """
    m, n = slip_systems(systems)
    rows = StateLayout(len(m))
    axis = rotation[:, 1]
    schmid = (axis @ m.T) * (axis @ n.T)
    strain = (eigenstrain * depth)[:, None, None] * _AXIAL
    strain = np.swapaxes(rotation, 1, 2) @ strain @ rotation
    n_state = rows.size if second else rows.x2
    state = np.zeros((len(rotation), n_state), dtype=np.result_type(schmid, strain, x0))
    if strain_measure == "finite":
        inverse = np.eye(3) - strain
        volume = np.linalg.det(inverse)[:, None, None]
        state[:, :9] = (inverse * volume ** (-1.0 / 3.0)).reshape(-1, 9)
    else:
        state[:, :5] = np.einsum("pij,kij->pk", strain, STRAIN_MODES[:5])
    state[:, rows.x : rows.over] = 2.0 * x0 * schmid
    return state


def depth_share(z: AnyArray, volume: AnyArray) -> AnyArray:
    """How far points lie below the mean, in shares of the depth.

    The depth is √18 times the standard deviation of Z over the volume, which is that of a
    triangular section, and 1.22 times that of a rectangle.

    Args:
        z: height of each point [µm], (n_points,).
        volume: volume of each point [µm³], (n_points,).
    """
    below = (volume @ z) / volume.sum() - z
    return np.asarray(below / np.sqrt(18.0 * (volume @ below**2) / volume.sum()))


def skin_factor(ratio: Any, thickness: Any, distance: AnyArray) -> AnyArray:
    """Factor on τ0 at a distance [µm] from the free surface, see `Material.skin_tau0`."""
    return np.asarray(1.0 + (ratio - 1.0) * np.exp(-distance / thickness))


def surface_distance(points: AnyArray, corners: AnyArray) -> AnyArray:
    """Distance of points inside a body from its nearest facet among those right above them.

    Args:
        points: coordinates [µm], (n_points, 3).
        corners: corners of each facet [µm], (n_facets, 3, 3).

    Returns:
        distances [µm], (n_points,).

    Raises:
        UnsupportedError: a point has no facet above it.
    """
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normals = np.cross(first, second)
    normals = normals / np.sqrt(np.sum(normals**2, axis=1, keepdims=True))
    offsets = np.sum(normals * corners[:, 0], axis=1)
    # Barycentric coordinates of a projection: the inverse of (first, second, normal).
    inverse = np.linalg.inv(np.stack([first, second, normals], axis=2).real)
    nearest = np.empty(len(points), dtype=np.int64)
    for part in np.array_split(np.arange(len(points)), len(points) * len(corners) // _PAIRS + 1):
        x = points[part].real
        share = np.einsum("fij,fj->fi", inverse, corners[:, 0].real)
        share = np.einsum("fij,pj->pfi", inverse[:, :2], x) - share[:, :2]
        above = (share >= -_EDGE).all(axis=2) & (share.sum(axis=2) <= 1 + _EDGE)
        distance = offsets.real - x @ normals.real.T
        if not above.any(axis=1).all():
            point = int(part[np.argmin(above.any(axis=1))])
            raise UnsupportedError(
                f"skin_tau0: no free facet lies right above Gauss point {point}; expected a "
                "specimen without re-entrant sides"
            )
        nearest[part] = np.argmin(np.where(above, abs(distance), np.inf), axis=1)
    signed = offsets[nearest] - np.sum(points * normals[nearest], axis=1)
    return np.asarray(np.sign(signed.real) * signed)

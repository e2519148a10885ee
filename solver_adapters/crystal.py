"""The 24 slip systems of a BCC crystal, and Bunge angles."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from meshes.arrays import FloatArray

N_SYSTEMS = 24
N_110 = 12

# Order of Code_Aster's BCC24: twelve {110}<111>, then twelve {112}<111>.
_NORMALS_DIRECTIONS = (
    ((0, 1, 1), (1, 1, -1)),
    ((1, 0, 1), (1, 1, -1)),
    ((1, -1, 0), (1, 1, -1)),
    ((0, 1, -1), (1, -1, -1)),
    ((1, 0, 1), (1, -1, -1)),
    ((1, 1, 0), (1, -1, -1)),
    ((0, 1, 1), (1, -1, 1)),
    ((1, 0, -1), (1, -1, 1)),
    ((1, 1, 0), (1, -1, 1)),
    ((0, 1, -1), (1, 1, 1)),
    ((1, 0, -1), (1, 1, 1)),
    ((1, -1, 0), (1, 1, 1)),
    ((2, -1, 1), (1, 1, -1)),
    ((1, -2, -1), (1, 1, -1)),
    ((1, 1, 2), (1, 1, -1)),
    ((2, 1, 1), (1, -1, -1)),
    ((1, 2, -1), (1, -1, -1)),
    ((1, -1, 2), (1, -1, -1)),
    ((2, 1, -1), (1, -1, 1)),
    ((1, 2, 1), (1, -1, 1)),
    ((1, -1, -2), (1, -1, 1)),
    ((2, -1, -1), (1, 1, 1)),
    ((1, -2, 1), (1, 1, 1)),
    ((1, 1, -2), (1, 1, 1)),
)


def system_name(system: int) -> str:
    """Return plane and direction of a slip system, such as `(0 1 1) [1 1 −1]`."""
    plane, direction = (
        " ".join(str(index).replace("-", "−") for index in indices)
        for indices in _NORMALS_DIRECTIONS[system]
    )
    return f"({plane}) [{direction}]"


def slip_systems() -> tuple[FloatArray, FloatArray]:
    """Return unit slip directions m and plane normals n in crystal axes, each of shape (24, 3)."""
    table = np.array(_NORMALS_DIRECTIONS, dtype=np.float64)
    unit = table / np.linalg.norm(table, axis=2, keepdims=True)
    return unit[:, 1], unit[:, 0]


def schmid_tensors() -> FloatArray:
    """Schmid tensor m ⊗ n of each system in crystal axes, shape (24, 3, 3)."""
    directions, normals = slip_systems()
    tensors: FloatArray = np.einsum("si,sj->sij", directions, normals)
    return tensors


def rotation_vector_matrix(vector: FloatArray) -> FloatArray:
    """Rotation matrix of a rotation vector [rad], shape (3,) → (3, 3)."""
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def bunge_matrix(phi1: float, capital_phi: float, phi2: float) -> FloatArray:
    """Crystal → sample rotation Rz(φ1)·Rx(Φ)·Rz(φ2) of Bunge angles in degrees, shape (3, 3).

    The columns are the crystal axes in the sample frame (the transpose of Bunge's matrix g).
    """
    angles = (phi1, capital_phi, phi2)
    return np.asarray(Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix())


def bunge_angles(rotation: FloatArray) -> tuple[float, float, float]:
    """Bunge angles φ1, Φ, φ2 in degrees of a crystal → sample rotation, 0 ≤ Φ ≤ 180.

    Where Φ is 0 or 180 only the sum or the difference of the others has a meaning: φ2 is what is
    left once φ1 has been turned back, so the three make the rotation for any Φ.
    """
    phi1 = np.arctan2(rotation[0, 2], -rotation[1, 2])
    capital_phi = np.arctan2(np.hypot(rotation[0, 2], rotation[1, 2]), rotation[2, 2])
    first_axis = np.cos(phi1) * rotation[0] + np.sin(phi1) * rotation[1]
    phi2 = np.arctan2(-first_axis[1], first_axis[0])
    degrees = np.rad2deg([phi1, capital_phi, phi2])
    return float(degrees[0]), float(degrees[1]), float(degrees[2])

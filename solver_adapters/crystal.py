"""Slip systems of cubic crystals, and Bunge angles."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray

SYSTEM_COUNTS = (24, 48)
"""Numbers of slip systems that arrays have, ascending: the first that holds those of a crystal.

Where a crystal has fewer, null ones that never slip follow them.
"""
MOST_SYSTEMS = SYSTEM_COUNTS[-1]
"""Most slip systems of a crystal."""
N_110, N_112 = 12, 12
"""Systems of {110} and of {112}, with which `BCC` and `BCC48` begin."""

_ROUNDING = 1e-6  # of the cosine of an angle

Indices = tuple[float, float, float]
SystemTable = tuple[tuple[Indices, Indices], ...]
"""Plane normal and slip direction of each system in crystal axes, of any length."""

BCC: SystemTable = (
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
"""Twelve {110}⟨111⟩, then twelve {112}⟨111⟩, in the order of Code_Aster's BCC24."""

BCC48: SystemTable = (
    *BCC,
    ((1, 2, 3), (1, 1, -1)),
    ((1, -3, -2), (1, 1, -1)),
    ((2, 1, 3), (1, 1, -1)),
    ((2, -3, -1), (1, 1, -1)),
    ((3, -1, 2), (1, 1, -1)),
    ((3, -2, 1), (1, 1, -1)),
    ((1, -2, 3), (1, -1, -1)),
    ((1, 3, -2), (1, -1, -1)),
    ((2, -1, 3), (1, -1, -1)),
    ((2, 3, -1), (1, -1, -1)),
    ((3, 1, 2), (1, -1, -1)),
    ((3, 2, 1), (1, -1, -1)),
    ((1, -2, -3), (1, -1, 1)),
    ((1, 3, 2), (1, -1, 1)),
    ((2, -1, -3), (1, -1, 1)),
    ((2, 3, 1), (1, -1, 1)),
    ((3, 1, -2), (1, -1, 1)),
    ((3, 2, -1), (1, -1, 1)),
    ((1, 2, -3), (1, 1, 1)),
    ((1, -3, 2), (1, 1, 1)),
    ((2, 1, -3), (1, 1, 1)),
    ((2, -3, 1), (1, 1, 1)),
    ((3, -1, -2), (1, 1, 1)),
    ((3, -2, -1), (1, 1, 1)),
)
"""Those of BCC, then twenty-four {123}⟨111⟩, direction by direction."""

FCC: SystemTable = (
    ((1, 1, 1), (-1, 0, 1)),
    ((1, 1, 1), (0, -1, 1)),
    ((1, 1, 1), (-1, 1, 0)),
    ((1, -1, 1), (-1, 0, 1)),
    ((1, -1, 1), (0, 1, 1)),
    ((1, -1, 1), (1, 1, 0)),
    ((-1, 1, 1), (0, -1, 1)),
    ((-1, 1, 1), (1, 1, 0)),
    ((-1, 1, 1), (1, 0, 1)),
    ((-1, -1, 1), (-1, 1, 0)),
    ((-1, -1, 1), (1, 0, 1)),
    ((-1, -1, 1), (0, 1, 1)),
)
"""Twelve {111}⟨110⟩, plane by plane."""


def table_fault(table: SystemTable) -> str | None:
    """Return what keeps a table from being one of slip systems, None where nothing does.

    Args:
        table: planes and directions, three finite numbers each.
    """
    if not 1 <= len(table) <= MOST_SYSTEMS:
        return f"{len(table)} systems"
    seen: list[FloatArray] = []
    for place, indices in enumerate(table, start=1):
        if not np.any(indices, axis=1).all():
            return f"system {place} with a plane or a direction of length 0"
        normal, direction = _of_length_1(np.array(indices, dtype=np.float64))
        if abs(normal @ direction) > _ROUNDING:
            return f"system {place} with a direction that does not lie in its plane"
        tensor = np.outer(direction, normal)
        for other, known in enumerate(seen, start=1):
            if abs(np.sum(tensor * known)) > 1.0 - _ROUNDING:
                return f"system {place} that is system {other} again"
        seen.append(tensor)
    return None


def system_count(table: SystemTable) -> int:
    """Return the length that arrays over the slip systems of a table have (`SYSTEM_COUNTS`).

    Args:
        table: at most `MOST_SYSTEMS`.
    """
    return next(count for count in SYSTEM_COUNTS if len(table) <= count)


def system_name(table: SystemTable, system: int) -> str:
    """Return plane and direction of a slip system, such as `(0 1 1) [1 1 −1]`."""
    plane, direction = (
        " ".join(f"{index:g}".replace("-", "−") for index in indices) for indices in table[system]
    )
    return f"({plane}) [{direction}]"


def slip_systems(table: SystemTable) -> tuple[FloatArray, FloatArray]:
    """Return unit slip directions m and plane normals n in crystal axes, each (n, 3).

    n is `system_count` of the table; those behind its last system are null.
    """
    indices = np.array(table, dtype=np.float64)
    unit = np.zeros((system_count(table), 2, 3))
    unit[: len(table)] = _of_length_1(indices)
    return unit[:, 1], unit[:, 0]


def _of_length_1(vectors: FloatArray) -> FloatArray:
    """Return vectors (..., 3) over their lengths, whose squares may be no number of normal size."""
    _, powers = np.frexp(np.abs(vectors).max(axis=-1, keepdims=True))
    scaled = np.ldexp(vectors, -powers)  # exact
    unit: FloatArray = scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)
    return unit


def schmid_tensors(table: SystemTable) -> FloatArray:
    """Schmid tensor m ⊗ n of each system in crystal axes, (n, 3, 3) with n of `slip_systems`."""
    directions, normals = slip_systems(table)
    tensors: FloatArray = np.einsum("si,sj->sij", directions, normals)
    return tensors


def rotation_vector_matrix(vector: FloatArray) -> FloatArray:
    """Rotation matrix of a rotation vector [rad], shape (3,) → (3, 3)."""
    # Its import takes a third of the start of every call of prismid, few of which turn crystals.
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def bunge_matrix(phi1: float, capital_phi: float, phi2: float) -> FloatArray:
    """Crystal → sample rotation Rz(φ1)·Rx(Φ)·Rz(φ2) of Bunge angles in degrees, shape (3, 3).

    The columns are the crystal axes in the sample frame (the transpose of Bunge's matrix g).
    """
    from scipy.spatial.transform import Rotation

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

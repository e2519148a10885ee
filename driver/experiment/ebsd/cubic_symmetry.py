"""Orientations of cubic crystals as quaternions (w, x, y, z), equal up to the 24 rotations."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from meshes.arrays import FloatArray

_CUBIC = Rotation.create_group("O").as_quat(scalar_first=True)
_CHUNK = 1 << 20


def disorientations(first: FloatArray, second: FloatArray) -> FloatArray:
    """Smallest angles [rad] between cubic crystals, of class 432 or m-3m.

    The rotation from one crystal to the other has, by absolute value, the components a ≥ b ≥ c ≥ d.
    Among its equivalents the largest first component, the cosine of half the angle, is one of a,
    (a + b)/√2 and (a + b + c + d)/2 (Grimmer, Acta Cryst. A30 (1974) 685).

    Args:
        first: crystal → sample, shape (n, 4).
        second: the same, shape (n, 4).
    """
    angles = np.empty(len(first))
    for start in range(0, len(first), _CHUNK):
        part = slice(start, start + _CHUNK)
        between = np.abs(product(first[part] * [1.0, -1.0, -1.0, -1.0], second[part]))
        d, c, b, a = np.sort(between, axis=1).T
        cosine = np.maximum(np.maximum(a, (a + b) / np.sqrt(2)), (a + b + c + d) / 2)
        angles[part] = 2 * np.arccos(np.minimum(cosine, 1.0))
    return angles


def product(first: FloatArray, second: FloatArray) -> FloatArray:
    """Hamilton products of quaternions, shapes (n, 4)."""
    w, x, y, z = first.T
    a, b, c, d = second.T
    return np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=1,
    )


def mean_orientation(rotations: FloatArray, start: FloatArray) -> FloatArray:
    """Mean of orientations of one grain, shape (4,).

    Each is replaced by the equivalent nearest to the mean so far. The mean is the eigenvector of
    Σ q qᵀ with the largest eigenvalue (Markley et al., J. Guid. Control Dyn. 30 (2007) 1193).

    Args:
        rotations: crystal → sample, shape (n, 4).
        start: one of them, or near them, shape (4,).
    """
    mean = start
    for _ in range(2):  # a start at the rim of the grain takes other equivalents than its mean
        moment = np.zeros((4, 4))
        for begin in range(0, len(rotations), _CHUNK):
            near = nearest_equivalents(rotations[begin : begin + _CHUNK], mean)
            moment += near.T @ near
        mean = np.linalg.eigh(moment)[1][:, -1]
        mean = mean * np.sign(mean @ start or 1.0)
    return mean


def nearest_equivalents(rotations: FloatArray, to: FloatArray) -> FloatArray:
    """Return of each orientation the equivalent q·s that is nearest to another one, shape (n, 4).

    Args:
        rotations: crystal → sample, shape (n, 4).
        to: the other one, shape (4,).
    """
    # ⟨to, q·s⟩ = ⟨to·s⁻¹, q⟩, so that one product serves all of q.
    inverse = _CUBIC * [1.0, -1.0, -1.0, -1.0]
    likeness = rotations @ product(np.broadcast_to(to, inverse.shape), inverse).T
    best = np.abs(likeness).argmax(axis=1)
    sign = np.sign(likeness[np.arange(len(rotations)), best])
    return np.asarray(product(rotations, _CUBIC[best]) * sign[:, None])

"""Which material point is seen at a place: the motion inverted by Newton's method."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from meshes.arrays import FloatArray

_TOLERANCE = 1e-11  # µm
_MAX_ITERATIONS = 25


class Motion(Protocol):
    """A motion of the face as a function of the material point."""

    def __call__(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u, v, w and their slopes at material points.

        Args:
            x: X [µm], shape (n,).
            y: Y [µm], shape (n,).

        Returns:
            u, v, w [µm], shape (n, 3), and their derivatives along X and Y [-], shape (n, 3, 2).
        """
        ...


def material_points(
    motion: Motion, x_now: FloatArray, y_now: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the points X with X + u(X) = x_now, and the height change w(X) there.

    Each step solves (1 + ∇u) δ = x_now − X − u(X). Where a finite-element motion has a kink, a
    step may land on its other side; the error then still falls by the jump of the strain.

    Args:
        motion: the motion, one-to-one.
        x_now: places in the image [µm], any shape.
        y_now: same shape.

    Returns:
        X, Y and w [µm], each of the shape of the places.

    Raises:
        ArithmeticError: no convergence, as where the motion folds the face.
    """
    target = np.column_stack([x_now.ravel(), y_now.ravel()])
    points = target.copy()
    for _ in range(_MAX_ITERATIONS):
        value, slopes = motion(points[:, 0], points[:, 1])
        residual = target - points - value[:, :2]
        if np.abs(residual).max() < _TOLERANCE:
            x, y, w = (a.reshape(x_now.shape) for a in (*points.T, value[:, 2]))
            return x, y, w
        points += np.linalg.solve(np.eye(2) + slopes[:, :2], residual[..., None])[..., 0]
    raise ArithmeticError(
        f"the motion of the face could not be inverted: {np.abs(residual).max():.2g} µm are left"
    )

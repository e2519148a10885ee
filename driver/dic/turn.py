"""Mean turn of a measured motion: an image that has turned has slopes that have turned with it."""

from __future__ import annotations

from math import atan2

import numpy as np

from meshes.arrays import FloatArray

_TURNED = np.radians(6.0)  # less slows the iteration down by a tenth


def mean_gradient(nodes: FloatArray, weights: FloatArray) -> FloatArray | None:
    """Return what gives the mean gradient of a motion from its nodal values, shape (2, n_uv).

    Args:
        nodes: X, Y of the nodes of u and v, shape (n_uv, 2).
        weights: how much the pixels tell of each node, shape (n_uv,).

    Returns:
        None where the nodes lie on a line.
    """
    places = nodes - weights @ nodes / weights.sum()
    weighted = places.T * weights
    spread = weighted @ places
    (xx, xy), (_, yy) = spread.tolist()
    area = xx * yy - xy * xy
    if not area > 0.0:
        return None
    return np.asarray(np.array([[yy, -xy], [-xy, xx]]) @ weighted / area)


def mean_turn(gradient: FloatArray | None, p: FloatArray) -> float:
    """Angle of the rotation in the mean gradient of a motion, 0 where it is small [rad].

    Args:
        gradient: of `mean_gradient`.
        p: nodal values [u | v | w] in the unit of the nodes, shape (n,).

    Returns:
        Positive from X to Y.
    """
    if gradient is None:
        return 0.0
    n = gradient.shape[1]
    along_x, along_y = (gradient @ p[: 2 * n].reshape(2, n).T).tolist()
    angle = atan2(along_x[1] - along_y[0], 2.0 + along_x[0] + along_y[1])
    return angle if abs(angle) > _TURNED else 0.0


def turned(p: FloatArray, n_uv: int, angle: float) -> FloatArray:
    """Return nodal values whose u, v are turned by an angle, shape (n,) as given."""
    if angle == 0.0:
        return p
    u, v, c, s = p[:n_uv], p[n_uv : 2 * n_uv], np.cos(angle), np.sin(angle)
    return np.concatenate([c * u - s * v, s * u + c * v, p[2 * n_uv :]])

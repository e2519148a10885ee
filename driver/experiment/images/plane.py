"""The best plane of a height map."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray


def plane_modes(rows: FloatArray, cols: FloatArray) -> FloatArray:
    """Orthonormal basis of offset and tilts over some pixels.

    Args:
        rows: row of each pixel, shape (n,).
        cols: column of each pixel, shape (n,).

    Returns:
        Three orthonormal columns, shape (n, 3); a height map h minus its best plane is
        h − Q (Qᵀ h).
    """
    return np.linalg.qr(np.column_stack([np.ones_like(rows), rows, cols]))[0]

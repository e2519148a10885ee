"""Modes of a series of images: model errors are slow in it, and what is fast is noise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from meshes.arrays import FloatArray


def cosine_modes(T: int, orders: NDArray[np.int64]) -> FloatArray:
    """Orthonormal cosines (DCT-II) of the given orders over T images, shape (n_orders, T)."""
    modes = np.sqrt(2 / T) * np.cos(np.pi * np.outer(orders, np.arange(T) + 0.5) / T)
    modes[orders == 0] /= np.sqrt(2)
    return np.asarray(modes)


def fast_modes(T: int) -> FloatArray:
    """Return the fast half of them, shape (T − T//2, T)."""
    return cosine_modes(T, np.arange(T // 2, T))

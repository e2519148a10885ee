"""Where the nodes of each group of a prism 12 µm long with a face of 4 µm stand."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

DEPTH = 2 * np.sqrt(3)


def group_masks(points: NDArray[np.float64]) -> dict[str, NDArray[np.bool_]]:
    """Whether each node belongs to a group, from its coordinates [µm] (n_nodes, 3)."""
    x, y, z = points.T
    apex = (abs(x) < 1e-9) & (abs(z + DEPTH) < 1e-9)
    return {
        "S_PLUS": y == 12,
        "S_MINUS": y == 0,
        "TOP": z == 0,
        "L_PLUS": (y == 12) & (z == 0),
        "L_MINUS": (y == 0) & (z == 0),
        "P_PLUS": (y == 12) & apex,
        "P_MINUS": (y == 0) & apex,
    }

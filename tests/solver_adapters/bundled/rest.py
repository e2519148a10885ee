"""The state of points before loading."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.initial import initial_state
from solver_adapters.bundled.law.gauss_points import Points
from solver_adapters.bundled.law.law import S_X2
from solver_adapters.crystal import BCC


def state_at_rest(points: Points) -> FloatArray:
    """Without back strain, eigenstrain or second back strain, (n_points, 81)."""
    rotation = points.rotation[points.frame_of]
    depth = np.zeros(points.grain.size)
    return initial_state(points.strain_measure, BCC, 0.0, 0.0, rotation, depth, S_X2)

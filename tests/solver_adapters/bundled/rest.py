"""The state of points before loading."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.initial import initial_state
from solver_adapters.bundled.law.gauss_points import Points
from solver_adapters.crystal import BCC, SystemTable


def state_at_rest(points: Points, systems: SystemTable = BCC) -> FloatArray:
    """Without back strain, eigenstrain or second back strain, (n_points, 81) for 24 systems."""
    rotation = points.rotation[points.frame_of]
    depth = np.zeros(points.grain.size)
    return initial_state(points.strain_measure, systems, 0.0, 0.0, rotation, depth, second=False)

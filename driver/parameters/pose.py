"""Parameters of the position of the specimen in the images."""

from __future__ import annotations

from solver_adapters.parameter import Parameter

POSE_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter("origin_X", "µm", 0.0, 0.05, -1.0, 1.0),
    Parameter("origin_Y", "µm", 0.0, 0.05, -1.0, 1.0),
)
"""By how much the pixels lie further along X and Y on the specimen than the case says."""

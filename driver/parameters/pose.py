"""Parameters of the position of the specimen in the images."""

from __future__ import annotations

from solver_adapters.parameter import NANOMETRES, Parameter

POSE_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(
        f"origin_{axis}", "µm", 0.0, 0.05, -1.0, 1.0, enters="pixels",
        label=f"error of the image origin along {axis}", short=f"origin {axis}",
        read_in=NANOMETRES,
    )
    for axis in "XY"
)  # fmt: skip
"""By how much the pixels lie further along X and Y on the specimen than the case says."""

"""Parameters of geometry and orientations."""

from __future__ import annotations

import numpy as np

from solver_adapters.parameter import PERCENT, Parameter

_DEGREE = np.pi / 180

GEOMETRY_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter(
        "boundary_shift", "µm", 0.0, 0.3, -3.0, 3.0, enters="nodes",
        label="shift of the boundary along Y",
    ),
    Parameter(
        "boundary_tilt_x", "", 0.0, 0.15, -1.0, 1.0, enters="nodes",
        label="slope of the boundary along X",
    ),
    Parameter(
        "boundary_tilt_z", "", 0.0, 0.15, -1.0, 1.0, enters="nodes",
        label="slope of the boundary along Z",
    ),
    Parameter(
        "boundary_bow", "µm", 0.0, 0.3, -2.0, 2.0, enters="nodes", label="bow of the boundary"
    ),
    Parameter(
        "depth_scale", "", 0.0, 0.05, -0.4, 0.4, enters="nodes", label="change of depth",
        read_in=PERCENT,
    ),
    Parameter(
        "apex_shift", "µm", 0.0, 0.2, -1.0, 1.0, enters="nodes", label="X of the apex line"
    ),
)  # fmt: skip

ROTATION_SCALE = 2 * _DEGREE
"""Prior scale of a component of the turn of a grain, or of the EBSD frame [rad]."""

_TURNED = {
    "rotation_grain1": "grain 1", "rotation_grain2": "grain 2", "rotation_frame": "the EBSD frame",
}  # fmt: skip
ORIENTATION_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(
        f"{what}_{axis}", "rad", 0.0, ROTATION_SCALE, -0.5, 0.5, enters="orientations",
        label=f"turn of {turned} about {axis.upper()}",
    )
    for what, turned in _TURNED.items()
    for axis in "xyz"
)  # fmt: skip

GRADIENTS = ("lattice_gradient_grain1", "lattice_gradient_grain2")
LATTICE_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(
        f"{what}_{axis}", "rad/µm", 0.0, 0.7 * _DEGREE / 12, -0.02, 0.02, enters="lattice",
        label=f"gradient of grain {grain} about {axis.upper()}",
    )
    for grain, what in enumerate(GRADIENTS, start=1)
    for axis in "xyz"
)  # fmt: skip
"""How the lattice of a grain turns along Y; the scale is 0.7° over the 12 µm of the paper."""

OF_BOUNDARY = ("boundary_shift", "boundary_tilt_x", "boundary_tilt_z", "boundary_bow")

"""Parameters of geometry and orientations."""

from __future__ import annotations

import numpy as np

from solver_adapters.parameter import Parameter

_DEGREE = np.pi / 180

GEOMETRY_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter("boundary_shift", "µm", 0.0, 0.3, -3.0, 3.0),
    Parameter("boundary_tilt_x", "", 0.0, 0.15, -1.0, 1.0),
    Parameter("boundary_tilt_z", "", 0.0, 0.15, -1.0, 1.0),
    Parameter("boundary_bow", "µm", 0.0, 0.3, -2.0, 2.0),
    Parameter("depth_scale", "", 0.0, 0.05, -0.4, 0.4),
    Parameter("apex_shift", "µm", 0.0, 0.2, -1.0, 1.0),
)

ORIENTATION_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(f"{what}_{axis}", "rad", 0.0, 2 * _DEGREE, -0.5, 0.5)
    for what in ("rotation_grain1", "rotation_grain2", "rotation_frame")
    for axis in "xyz"
)

GRADIENTS = ("lattice_gradient_grain1", "lattice_gradient_grain2")

LATTICE_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(f"{what}_{axis}", "rad/µm", 0.0, 0.7 * _DEGREE / 12, -0.02, 0.02)
    for what in GRADIENTS
    for axis in "xyz"
)
"""How the lattice of a grain turns along Y; the scale is 0.7° over the 12 µm of the paper."""

OF_BOUNDARY = ("boundary_shift", "boundary_tilt_x", "boundary_tilt_z", "boundary_bow")

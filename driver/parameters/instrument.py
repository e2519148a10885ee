"""Parameters of load cell and microscope."""

from __future__ import annotations

from solver_adapters.parameter import Parameter

LARGEST_LAG = 60.0
"""Largest lag that is considered [s]: two holds."""

LOAD_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter("load_gain", "", 0.0, 0.03, -0.9, 2.0),
    Parameter("load_offset", "µN", 0.0, 10.0),
    Parameter("load_drift", "µN", 0.0, 20.0),
    Parameter("load_lag", "s", 0.0, 3.0, -LARGEST_LAG, LARGEST_LAG),
)

IMAGE_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter("height_scale", "", 0.0, 0.03, -0.5, 0.5),
    Parameter("height_drift", "µm", 0.0, 5e-3, -1.0, 1.0),
    Parameter("magnification_drift", "", 0.0, 5e-4, -5e-3, 5e-3),
    Parameter("scan_shear_drift", "", 0.0, 5e-4, -5e-3, 5e-3),
    Parameter("tilt_drift", "", 0.0, 5e-4, -5e-3, 5e-3),
)

PATTERN_DECLARATIONS: tuple[Parameter, ...] = (Parameter("fixed_pattern", "", 0.0, 0.2, -3.0, 3.0),)
"""Share of the flat pattern that is left in the images."""

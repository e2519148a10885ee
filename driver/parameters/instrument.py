"""Parameters of load cell and microscope."""

from __future__ import annotations

from solver_adapters.parameter import MILLIRADIANS, NANOMETRES, PERCENT, Parameter

LARGEST_LAG = 60.0
"""Largest lag that is considered [s]: two holds."""

LOAD_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter(
        "load_gain", "", 0.0, 0.03, -0.9, 2.0, enters="load", label="error of the load gain",
        short="load gain", deviation_key="sections.relative_uncertainty", read_in=PERCENT,
    ),
    Parameter(
        "load_offset", "µN", 0.0, 10.0, enters="load", label="load offset",
        deviation_key="loads.offset_uncertainty_uN",
    ),
    Parameter("load_drift", "µN", 0.0, 20.0, enters="load", label="load drift over the test"),
    Parameter(
        "load_lag", "s", 0.0, 3.0, -LARGEST_LAG, LARGEST_LAG, enters="load",
        label="lag of the load behind the image", deviation_key="loads.clock_uncertainty_s",
    ),
)  # fmt: skip

IMAGE_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter(
        "height_scale", "", 0.0, 0.03, -0.5, 0.5, enters="images",
        label="error of the height scale", read_in=PERCENT,
    ),
    Parameter(
        "height_drift", "µm", 0.0, 5e-3, -1.0, 1.0, enters="images", label="drift of the heights",
        read_in=NANOMETRES,
    ),
    Parameter(
        "magnification_drift", "", 0.0, 5e-4, -5e-3, 5e-3, enters="images",
        label="drift of magnification", read_in=PERCENT, ends_at_bounds=True,
    ),
    Parameter(
        "scan_shear_drift", "", 0.0, 5e-4, -5e-3, 5e-3, enters="images",
        label="drift of the shear of the field", read_in=MILLIRADIANS, ends_at_bounds=True,
    ),
    Parameter(
        "tilt_drift", "", 0.0, 5e-4, -5e-3, 5e-3, enters="images",
        label="drift of the tilt of the field", read_in=MILLIRADIANS, ends_at_bounds=True,
    ),
)  # fmt: skip

PATTERN_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter(
        "fixed_pattern", "", 0.0, 0.2, -3.0, 3.0, enters="pattern",
        label="share of the flat pattern left",
    ),
)  # fmt: skip

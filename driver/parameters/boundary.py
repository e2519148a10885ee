"""Parameters of the motion of the end faces."""

from __future__ import annotations

import re

from solver_adapters.parameter import NANOMETRES, PERCENT, Parameter

AMPLITUDE_DECLARATIONS: tuple[Parameter, ...] = tuple(
    Parameter(
        f"lambda_{apex}", "", 1.0, 0.1, -3.0, 5.0, enters="ends", label=sign,
        key=f"boundary.lambda_start.{apex}",
    )
    for apex, sign in (
        ("plus_Y", "λ⁺_Y"), ("plus_Z", "λ⁺_Z"), ("minus_Y", "λ⁻_Y"), ("minus_Z", "λ⁻_Z"),
    )
)  # fmt: skip
LAMBDAS = tuple(parameter.name for parameter in AMPLITUDE_DECLARATIONS)

BOUNDARY_DECLARATIONS: tuple[Parameter, ...] = (
    *AMPLITUDE_DECLARATIONS,
    Parameter(
        "apex_curvature", "", 0.0, 0.2, -3.0, 3.0, enters="ends",
        label="apex amplitude growing with strain",
    ),
    Parameter(
        "end_rotation", "", 0.0, 0.1, -2.0, 2.0, enters="ends", label="in-plane turn of S⁺"
    ),
    Parameter(
        "end_shear", "", 0.0, 0.1, -2.0, 2.0, enters="ends",
        label="sideways motion of S⁺ / half elongation",
    ),
    Parameter(
        "stretch_curvature", "", 0.0, 0.03, -0.8, 0.8, enters="ends",
        label="bow of the elongation over stage travel", read_in=PERCENT,
    ),
)  # fmt: skip


def elongation_names(n_knots: int) -> tuple[str, ...]:
    """Names of the free elongation knots; the first knot is the unloaded state."""
    return tuple(f"elongation_{k}" for k in range(1, n_knots))


def tilt_names(n_knots: int) -> tuple[str, ...]:
    """Names of the free tilt knots, U_Z(S+) − U_Z(S−)."""
    return tuple(f"tilt_{k}" for k in range(1, n_knots))


def knot_number(name: str) -> int | None:
    """Return the number of the knot that a parameter is; None of one that is no knot."""
    knot = re.fullmatch(r"(?:elongation|tilt)_(\d+)", name)
    return int(knot[1]) if knot else None


def knot_declarations(n_knots: int) -> tuple[Parameter, ...]:
    """Return the knots [µm]; their scale is the elongation that an image resolves."""
    return tuple(
        Parameter(
            name, "µm", 0.0, 0.01, enters="knots", label=f"{sign}, knot {k}",
            short=f"{sign} {k}", read_in=NANOMETRES,
        )
        for names, sign in ((elongation_names(n_knots), "ΔU_Y"), (tilt_names(n_knots), "ΔU_Z"))
        for k, name in enumerate(names, start=1)
    )  # fmt: skip

"""Parameters of the motion of the end faces."""

from __future__ import annotations

from solver_adapters.parameter import Parameter

LAMBDAS = ("lambda_plus_Y", "lambda_plus_Z", "lambda_minus_Y", "lambda_minus_Z")

BOUNDARY_DECLARATIONS: tuple[Parameter, ...] = (
    *(Parameter(name, "", 1.0, 0.1, -3.0, 5.0) for name in LAMBDAS),
    Parameter("apex_curvature", "", 0.0, 0.2, -3.0, 3.0),
    Parameter("end_rotation", "", 0.0, 0.1, -2.0, 2.0),
    Parameter("end_shear", "", 0.0, 0.1, -2.0, 2.0),
    Parameter("stretch_curvature", "", 0.0, 0.03, -0.8, 0.8),
)


def elongation_names(n_knots: int) -> tuple[str, ...]:
    """Names of the free elongation knots; the first knot is the unloaded state."""
    return tuple(f"elongation_{k}" for k in range(1, n_knots))


def tilt_names(n_knots: int) -> tuple[str, ...]:
    """Names of the free tilt knots, U_Z(S+) − U_Z(S−)."""
    return tuple(f"tilt_{k}" for k in range(1, n_knots))


def knot_declarations(n_knots: int) -> tuple[Parameter, ...]:
    """The knots [µm]; their scale is the elongation that an image resolves."""
    names = elongation_names(n_knots) + tilt_names(n_knots)
    return tuple(Parameter(name, "µm", 0.0, 0.01) for name in names)

"""Parameters of geometry and orientations."""

from __future__ import annotations

import re

import numpy as np

from solver_adapters.parameter import PERCENT, Parameter

_DEGREE = np.pi / 180

_OF_SECTION: tuple[Parameter, ...] = (
    Parameter(
        "depth_scale", "", 0.0, 0.05, -0.4, 0.4, enters="nodes", label="change of depth",
        read_in=PERCENT,
    ),
    Parameter(
        "apex_shift", "µm", 0.0, 0.2, -1.0, 1.0, enters="nodes", label="X of the apex line"
    ),
)  # fmt: skip


def boundary_names(n_grains: int) -> tuple[tuple[str, str, str, str], ...]:
    """Names of shift, slopes along X and Z, and bow of each grain boundary, in their order.

    The one boundary of two grains bears no number.
    """
    numbers = ("",) if n_grains == 2 else range(1, n_grains)
    return tuple(
        (
            f"boundary{number}_shift",
            f"boundary{number}_tilt_x",
            f"boundary{number}_tilt_z",
            f"boundary{number}_bow",
        )
        for number in numbers
    )


def moves_boundary(name: str) -> bool:
    """Whether a name is that of a parameter, or of a cause, of the place of a grain boundary."""
    return _OF_BOUNDARY.match(name) is not None


_OF_BOUNDARY = re.compile(r"boundary\d*_(shift|tilt|bow|position)")


def geometry_declarations(n_grains: int) -> tuple[Parameter, ...]:
    """Return what moves the nodes: each grain boundary, and the section."""
    of_boundaries: list[Parameter] = []
    for number, (shift, tilt_x, tilt_z, bow) in enumerate(boundary_names(n_grains), start=1):
        which = "the boundary" if n_grains == 2 else f"boundary {number}"
        of_boundaries += [
            Parameter(
                shift, "µm", 0.0, 0.3, -3.0, 3.0, enters="nodes", label=f"shift of {which} along Y"
            ),
            *(
                Parameter(
                    name, "", 0.0, 0.15, -1.0, 1.0, enters="nodes",
                    label=f"slope of {which} along {axis}",
                )
                for name, axis in ((tilt_x, "X"), (tilt_z, "Z"))
            ),
            Parameter(bow, "µm", 0.0, 0.3, -2.0, 2.0, enters="nodes", label=f"bow of {which}"),
        ]  # fmt: skip
    return (*of_boundaries, *_OF_SECTION)


ROTATION_SCALE = 2 * _DEGREE
"""Prior scale of a component of the turn of a grain, or of the EBSD frame [rad]."""


def orientation_declarations(n_grains: int) -> tuple[Parameter, ...]:
    """Return the turn of each grain, and that of the EBSD frame."""
    turned = {f"rotation_grain{k}": f"grain {k}" for k in range(1, n_grains + 1)}
    turned["rotation_frame"] = "the EBSD frame"
    return tuple(
        Parameter(
            f"{what}_{axis}", "rad", 0.0, ROTATION_SCALE, -0.5, 0.5, enters="orientations",
            label=f"turn of {of} about {axis.upper()}",
        )
        for what, of in turned.items()
        for axis in "xyz"
    )  # fmt: skip


def gradient_name(grain: int) -> str:
    """Beginning of the names of the gradient of the lattice of a grain, by its number."""
    return f"lattice_gradient_grain{grain}"


def lattice_declarations(n_grains: int) -> tuple[Parameter, ...]:
    """Return how the lattice of each grain turns along Y.

    The scale is 0.7° over the 12 µm of the paper.
    """
    return tuple(
        Parameter(
            f"{gradient_name(grain)}_{axis}", "rad/µm", 0.0, 0.7 * _DEGREE / 12, -0.02, 0.02,
            enters="lattice", label=f"gradient of grain {grain} about {axis.upper()}",
        )
        for grain in range(1, n_grains + 1)
        for axis in "xyz"
    )  # fmt: skip


def grains_that_bear(name: str) -> int:
    """Return the fewest grains of a specimen that has a parameter or a cause of this name.

    Two where it tells no more: one grain has a part of what two have.
    """
    grain, boundary = _NUMBERED["grain"].search(name), _NUMBERED["boundary"].match(name)
    if boundary is not None:
        return max(3, int(boundary[1]) + 1)
    if grain is None:
        return 2
    return max(3 if grain.start() == 0 else 2, int(grain[1]))


_NUMBERED = {what: re.compile(rf"{what}([1-9]\d{{0,2}})(?!\d)") for what in ("grain", "boundary")}

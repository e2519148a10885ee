"""Planes between the grains of a specimen."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import hypot, isfinite

import numpy as np

from meshes.arrays import FloatArray
from meshes.section import Section

Vector = tuple[float, float, float]
_TINY, _HUGE = 1e-100, 1e100  # lengths of a normal whose square is a number
THINNEST = 0.01
"""Thickness of one of several grains over the width, below which its cells would be flat."""


def is_direction(normal: Vector) -> bool:
    """Whether a vector has a direction: it is finite and not zero."""
    return all(map(isfinite, normal)) and _TINY < hypot(*normal) < _HUGE


@dataclass(frozen=True)
class GrainBoundary:
    """A plane between two grains.

    Attributes:
        point: a point of it [µm].
        normal: its normal, of any length; it points out of the grain of the smaller number.

    Raises:
        ValueError: the normal is zero, or a number is not finite.
    """

    point: Vector
    normal: Vector

    def __post_init__(self) -> None:
        """Refuse what is no plane."""
        if not all(map(isfinite, self.point)) or not is_direction(self.normal):
            raise ValueError(
                f"grain boundary through {self.point} with normal {self.normal}: finite numbers "
                "and a non-zero normal are expected"
            )

    @property
    def unit_normal(self) -> FloatArray:
        """Normal of length one, shape (3,)."""
        normal = np.asarray(self.normal, dtype=float)
        return np.asarray(normal / np.linalg.norm(normal))

    def distance(self, points: FloatArray) -> FloatArray:
        """Signed distance from the plane [µm], negative in the grain of the smaller number.

        Args:
            points: coordinates [µm], shape (..., 3).

        Returns:
            distance, shape (...).
        """
        distance: FloatArray = (points - np.asarray(self.point)) @ self.unit_normal
        return distance

    def height(self, points: FloatArray, length: float) -> FloatArray:
        """Y of the plane [µm] at the X and Z of each point, shape (n,).

        Args:
            points: coordinates [µm], shape (n, 3).
            length: of the specimen [µm].

        Raises:
            ValueError: the plane meets an end face at one of the points.
        """
        at_section = points * np.array([1.0, 0.0, 1.0])
        distance = self.distance(at_section)
        per_y = float(self.distance(at_section[0] + np.array([0, 1.0, 0])) - distance[0])
        if per_y != 0:
            with np.errstate(over="ignore"):  # of a plane all but along the specimen
                height: FloatArray = -distance / per_y
            if 0 < height.min() and height.max() < length:
                return height
        raise ValueError(
            f"{self} meets an end face or a side along the whole prism: it is expected to cross "
            "the prism from side to side"
        )

    def __str__(self) -> str:
        """Return the plane as a subject of a sentence."""
        return f"the grain boundary through {self.point} with normal {self.normal}"


@dataclass(frozen=True)
class BoundaryFault:
    """Why planes do not part a row of grains.

    Attributes:
        number: of the plane, from 1.
        found: what was found of it.
        expected: what was expected.
    """

    number: int
    found: str
    expected: str


def fault_of(
    boundaries: Sequence[GrainBoundary], section: Section, length: float
) -> BoundaryFault | None:
    """Return the first fault of several boundaries, None where there is none.

    A single one may meet an end face, which tetrahedra can follow.

    Args:
        boundaries: in the order of the grains.
        section: of the specimen.
        length: of the specimen [µm].
    """
    if len(boundaries) < 2:
        return None
    corners, sense = section.corners_between(0.0), boundaries[0].normal[1] > 0
    heights: list[FloatArray] = []
    least = THINNEST * section.width
    for number, boundary in enumerate(boundaries, start=1):
        try:
            heights.append(boundary.height(corners, length))
        except ValueError:
            found = f"a plane through {boundary.point} that meets an end face"
            return BoundaryFault(number, found, "one that crosses from side to side")
        if heights[-1].min() < least or heights[-1].max() > length - least:
            found = f"a plane through {boundary.point} that all but meets an end face"
            return BoundaryFault(number, found, f"{least:.2g} µm or more between both")
        if (boundary.normal[1] > 0) != sense:
            found = f"the normal {boundary.normal}, against that of boundary 1 along Y"
            expected = "normals that all point from one grain to the next"
            return BoundaryFault(number, found, expected)
    for number, (one, other) in enumerate(pairwise(heights), start=2):
        gap = other - one if sense else one - other
        before = f"boundary {number - 1}"
        if gap.max() <= 0:
            found = f"a plane on the side of grain {number - 1} of {before}"
            return BoundaryFault(number, found, "boundaries in the order of the grains")
        if gap.min() < least:
            found = f"a plane that crosses or touches {before} inside the specimen"
            expected = f"{least:.2g} µm or more of grain {number} between them"
            return BoundaryFault(number, found, expected)
    return None

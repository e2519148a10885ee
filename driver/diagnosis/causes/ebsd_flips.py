"""Discrete mistakes of the EBSD frame: half turns about the axes of the specimen.

A flip has no parameter and no sensitivity: it is another set of orientations, tried as it is.
Cubic crystals have a centre of symmetry, so that a mirrored frame (a coordinate of the wrong sign,
a left-handed frame) is the half turn about the axis across the mirror: diag(−1, 1, 1) = −diag(1,
−1, −1). Where half turns about the axes of the EBSD frame are meant, they are the same three
as long as these axes are parallel to those of the specimen, in any order and sense.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product

import numpy as np

from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.causes.causes import Cause
from meshes.arrays import FloatArray

ODDS = 0.01
"""Prior odds of each flip against none: one specimen in a hundred."""
SAME = 0.5
"""Disorientation [degrees] below which two lattices are the same: that of good EBSD itself."""

FLIPS: tuple[Cause, ...] = tuple(
    Cause(
        f"ebsd_flip_{axis}", "microstructure", (),
        f"the EBSD frame is turned by half a turn about the {axis.upper()} axis of the specimen",
        "a mark on the specimen that EBSD map and images both show, and the sign conventions of "
        "the EBSD software",
        odds=ODDS,
        label=f"EBSD frame turned by half a turn about {axis.upper()}",
    )
    for axis in "xyz"
)  # fmt: skip

_TURNS = {
    flip.name: np.diag(signs)
    for flip, signs in zip(
        FLIPS, ([1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]), strict=True
    )
}


def _cubic_rotations() -> FloatArray:
    """Return the 24 rotations of a cube onto itself, shape (24, 3, 3)."""
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.array([matrix for matrix in signed if np.linalg.det(matrix) > 0])


_CUBIC = _cubic_rotations()


def half_turn(causes: Sequence[Cause]) -> FloatArray:
    """Return the rotation of the specimen frame by the flips among these causes, shape (3, 3)."""
    turn = np.eye(3)
    for cause in causes:
        turn = _TURNS.get(cause.name, np.eye(3)) @ turn
    return turn


def disorientation(turn: FloatArray, orientation: FloatArray) -> float:
    """Smallest angle [degrees] between a cubic lattice and itself turned.

    Args:
        turn: a rotation in the specimen frame, shape (3, 3).
        orientation: crystal → specimen, shape (3, 3).
    """
    relative = orientation.T @ turn @ orientation
    cosine = (np.einsum("ij,sij->s", relative, _CUBIC).max() - 1.0) / 2.0
    return float(np.rad2deg(np.arccos(min(cosine, 1.0))))


def flips_of(
    orientations: FloatArray, wanted: Sequence[str] | None
) -> tuple[tuple[Cause, ...], tuple[NotExamined, ...]]:
    """Return the flips that make lattices of their own, and the others with the reason.

    Args:
        orientations: crystal → specimen of each grain, shape (n_grains, 3, 3).
        wanted: names of the causes to try, None for all.
    """
    kept: list[Cause] = []
    left: list[NotExamined] = []
    for flip in FLIPS:
        if wanted is not None and flip.name not in wanted:
            continue
        alike = [other.title for other in kept if _same((flip, other), orientations)]
        if _same((flip,), orientations):
            left.append(NotExamined(flip.name, "it changes no lattice of this specimen"))
        elif alike:
            left.append(NotExamined(flip.name, f"it makes the same lattices as {alike[0]}"))
        else:
            kept.append(flip)
    return tuple(kept), tuple(left)


def _same(flips: Sequence[Cause], orientations: FloatArray) -> bool:
    """Whether flips one after the other leave every lattice as it is."""
    turn = half_turn(flips)
    return all(disorientation(turn, orientation) < SAME for orientation in orientations)

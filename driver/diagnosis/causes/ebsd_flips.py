"""Discrete mistakes of the EBSD frame: half turns about the axes of the specimen, quarter turns.

A flip has no parameter and no sensitivity: it is another set of orientations, tried as it is.
Cubic crystals have a centre of symmetry, so that a mirrored frame (a coordinate of the wrong sign,
a left-handed frame) is the half turn about the axis across the mirror: diag(−1, 1, 1) = −diag(1,
−1, −1). Where half turns about the axes of the EBSD frame are meant, they are the same three
as long as these axes are parallel to those of the specimen, in any order and sense. Quarter turns
about the normal and half turns about the diagonals of the face exchange X and Y: a map put in
across, and what lies between the frames of one manufacturer and of another.
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

_CHECK = (
    "a mark on the specimen that EBSD map and images both show, and the sign conventions of the "
    "EBSD software"
)


def _flip(name: str, turn: str) -> Cause:
    of = "" if "diagonal" in turn else " axis of the specimen"
    return Cause(
        f"ebsd_{name}", "microstructure", (),
        f"the EBSD frame is turned by {turn}{of}",
        _CHECK,
        odds=ODDS,
        label=f"EBSD frame turned by {turn if not of else turn.replace('the ', '')}",
    )  # fmt: skip


HALF_TURNS: tuple[Cause, ...] = tuple(
    _flip(f"flip_{axis}", f"half a turn about the {axis.upper()}") for axis in "xyz"
)
ACROSS: tuple[Cause, ...] = (
    _flip("quarter_z", "a quarter turn (X to Y) about the Z"),
    _flip("quarter_minus_z", "a quarter turn (Y to X) about the Z"),
    _flip("flip_xy", "half a turn about the diagonal between X and Y"),
    _flip("flip_minus_xy", "half a turn about the diagonal between X and −Y"),
)
"""Those that exchange X and Y."""
FLIPS: tuple[Cause, ...] = (*HALF_TURNS, *ACROSS)

_TURNS = {
    flip.name: np.array(turn)
    for flip, turn in zip(
        FLIPS,
        (
            np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, 1.0, -1.0]), np.diag([-1.0, -1.0, 1.0]),
            [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]],
            [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
            [[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]],
        ),
        strict=True,
    )
}  # fmt: skip


def _cubic_rotations() -> FloatArray:
    """Return the 24 rotations of a cube onto itself, shape (24, 3, 3)."""
    signed = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in permutations(range(3))
        for signs in product((1.0, -1.0), repeat=3)
    ]
    return np.array([matrix for matrix in signed if np.linalg.det(matrix) > 0])


_CUBIC = _cubic_rotations()


def frame_turn(causes: Sequence[Cause]) -> FloatArray:
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
    return float(np.rad2deg(from_lattice(orientation, turn @ orientation)))


def from_lattice(one: FloatArray, other: FloatArray) -> float:
    """Smallest angle [rad] between two cubic lattices, crystal → specimen, shape (3, 3) each."""
    cosine = (np.einsum("ij,sij->s", one.T @ other, _CUBIC).max() - 1.0) / 2.0
    return float(np.arccos(min(cosine, 1.0)))


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
        turn = frame_turn((flip,))
        alike = [o.title for o in kept if _same(frame_turn((o,)).T @ turn, orientations)]
        if _same(turn, orientations):
            left.append(NotExamined(flip.name, "it changes no lattice of this specimen"))
        elif alike:
            left.append(NotExamined(flip.name, f"it makes the same lattices as {alike[0]}"))
        else:
            kept.append(flip)
    return tuple(kept), tuple(left)


def _same(turn: FloatArray, orientations: FloatArray) -> bool:
    """Whether a turn of the specimen frame leaves every lattice as it is."""
    return all(disorientation(turn, orientation) < SAME for orientation in orientations)

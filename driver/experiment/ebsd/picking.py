"""A grain of an EBSD map, picked by a point or by its number: mean orientation and spread."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from driver.case.grains import EbsdFrame
from driver.experiment.ebsd.cubic_symmetry import disorientations, mean_orientation
from driver.experiment.ebsd.maps import CUBIC, EbsdMap
from driver.experiment.ebsd.segmentation import grid_steps
from driver.experiment.images.files import Refused
from meshes.arrays import FloatArray, IntArray

_LISTED = 5  # grains that are named where none was picked


@dataclass(frozen=True)
class Pick:
    """What picks a grain: a point of the map, or the number that its file gives a grain.

    Attributes:
        point: x and y [µm], or None.
        grain: the number, or None.
        along: direction of the map, x and y, in whose order grains are told where none is met.
    """

    point: tuple[float, float] | None = None
    grain: int | None = None
    along: tuple[float, float] = (0.0, 1.0)


@dataclass(frozen=True, eq=False)
class PickedGrain:
    """A grain of a map.

    Attributes:
        rotation: mean of its points, from the crystal to the frame of the Euler angles,
            shape (3, 3).
        spread: root mean square of the disorientation of its points from that mean [rad].
        points: their number.
        place: x and y of the point that was picked, or of one in the middle [µm].
        surroundings: indexed points of the whole map, and all of them.
        surface: Euler angles of the acquired surface, as the file states them [degrees].
        like_radians: whether angles of the map look like radians, and should be degrees.
        makers: of the system whose software has written the map, none where that is not known.
    """

    rotation: FloatArray
    spread: float
    points: int
    place: tuple[float, float]
    surroundings: tuple[int, int]
    surface: tuple[float, float, float]
    like_radians: bool
    makers: tuple[EbsdFrame, ...] = ()


def picked_grain(points: EbsdMap, numbers: IntArray, pick: Pick) -> PickedGrain:
    """Return the grain that was picked.

    Args:
        points: the map.
        numbers: the grain of each of its points (`grain_numbers`), shape (n,).
        pick: what picks it.

    Raises:
        Refused: the pick meets no grain, or a crystal that is not cubic.
    """
    start, members = members_of(points, numbers, pick)
    rotations = points.rotations[members]
    mean = mean_orientation(rotations, points.rotations[start])
    angles = disorientations(np.broadcast_to(mean, rotations.shape), rotations)
    return PickedGrain(
        rotation=np.asarray(Rotation.from_quat(mean, scalar_first=True).as_matrix()),
        spread=float(np.sqrt(np.mean(angles**2))),
        points=members.size,
        place=(float(points.x[start]), float(points.y[start])),
        surroundings=(int(np.count_nonzero(points.indexed)), points.x.size),
        surface=points.surface,
        like_radians=points.like_radians,
        makers=points.makers,
    )


def members_of(points: EbsdMap, numbers: IntArray, pick: Pick) -> tuple[int, IntArray]:
    """Return the point of the map that stands for a picked grain, and all points of it.

    Args:
        points: the map.
        numbers: the grain of each of its points (`grain_numbers`), shape (n,).
        pick: what picks it.

    Raises:
        Refused: the pick meets no grain, or a crystal that is not cubic.
    """
    if pick.grain is not None:
        members = _counted(points, numbers, pick.grain, pick.along)
        middle = np.median(points.x[members]), np.median(points.y[members])
        start = _nearest(points, members, (float(middle[0]), float(middle[1])))
    else:
        start = _met(points, numbers, pick)
        members = np.flatnonzero(numbers == numbers[start])
    return start, members


def _counted(
    points: EbsdMap, numbers: IntArray, grain: int, along: tuple[float, float]
) -> IntArray:
    """Return the points of a grain of that number."""
    if points.grain_ids is None:
        absent = f"ebsd_grain = {grain}, but no numbers of grains in it"
        raise Refused(absent, _choice(points, numbers, along))
    everywhere = points.grain_ids == grain
    members = np.flatnonzero(everywhere & points.cubic)
    if members.size:
        return members
    if (everywhere & points.indexed).any():
        raise _not_cubic(points, int(points.phase[everywhere & points.indexed][0]))
    known, sizes = np.unique(points.grain_ids[points.cubic], return_counts=True)
    largest = known[np.argsort(-sizes, kind="stable")[:_LISTED]]
    some = ", ".join(str(number) for number in largest.tolist())
    raise Refused(f"ebsd_grain = {grain}, which no point has", f"one of its grains, such as {some}")


def _met(points: EbsdMap, numbers: IntArray, pick: Pick) -> int:
    """Return the point of the map that a place in it meets."""
    point = pick.point
    if point is None:
        raise Refused("no grain that is picked", _choice(points, numbers, pick.along))
    shown = f"ebsd_point_um = [{point[0]:g}, {point[1]:g}]"
    met = _nearest(points, np.arange(points.x.size), point)
    steps = grid_steps(points)
    away = abs(points.x[met] - point[0]), abs(points.y[met] - point[1])
    if away[0] > steps[0] or away[1] > steps[1]:
        raise Refused(f"{shown}, where it has no point", _choice(points, numbers, pick.along))
    if not points.indexed[met]:
        raise Refused(f"{shown}, which was not indexed", _choice(points, numbers, pick.along))
    if not points.cubic[met]:
        raise _not_cubic(points, int(points.phase[met]))
    return met


def _nearest(points: EbsdMap, among: IntArray, place: tuple[float, float]) -> int:
    away = (points.x[among] - place[0]) ** 2 + (points.y[among] - place[1]) ** 2
    return int(among[np.argmin(away)])


def _not_cubic(points: EbsdMap, key: int) -> Refused:
    phase = points.phases.get(key)
    symmetry = f"of Laue class {phase.laue}" if phase and phase.laue else "of no stated symmetry"
    name = phase.name if phase else str(key)
    return Refused(
        f"the phase “{name}” {symmetry} there",
        f"a cubic crystal of class {CUBIC} (432), which the law describes",
    )


def _choice(points: EbsdMap, numbers: IntArray, along: tuple[float, float]) -> str:
    """Say what can be picked: the extent of the map and its largest grains, in their order."""
    x, y = points.x, points.y
    extent = f"x from {x.min():g} to {x.max():g} and y from {y.min():g} to {y.max():g}"
    sizes = np.bincount(numbers[numbers >= 0])
    told: list[tuple[float, str]] = []
    for number in np.argsort(-sizes, kind="stable")[:_LISTED].tolist():
        members = np.flatnonzero(numbers == number)
        middle = float(np.median(x[members])), float(np.median(y[members]))
        inside = _nearest(points, members, middle)
        order = along[0] * middle[0] + along[1] * middle[1]
        told.append((order, _one_choice(points, members, inside)))
    if not told:
        return f"a map with a cubic phase of class {CUBIC}"
    by_number = "" if points.grain_ids is None else ", or ebsd_grain, a number of its own"
    return (
        f"ebsd_point_um = [x, y] with {extent}, such as in its largest grains, in their order "
        f"along Y by orientation.ebsd_to_specimen: {', '.join(text for _, text in sorted(told))}"
        f"{by_number}"
    )


def _one_choice(points: EbsdMap, members: IntArray, inside: int) -> str:
    """Say where a grain lies and how large it is."""
    x, y = points.x[members], points.y[members]
    steps = grid_steps(points)
    size = f"{np.ptp(x) + steps[0]:.3g} × {np.ptp(y) + steps[1]:.3g} µm, {members.size} points"
    if points.grain_ids is not None:
        size += f", grain {points.grain_ids[inside]}"
    return f"[{points.x[inside]:g}, {points.y[inside]:g}] ({size})"

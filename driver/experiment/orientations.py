"""Orientations of the grains of a case: the one place where Bunge angles or a map become them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np

from driver.case.model import Case
from driver.common.errors import InputError, sentence, why
from driver.experiment.ebsd.boundary_trace import MapTrace, boundary_trace
from driver.experiment.ebsd.headers import EXPECTED
from driver.experiment.ebsd.maps import read_map
from driver.experiment.ebsd.picking import Pick, PickedGrain, members_of, picked_grain
from driver.experiment.ebsd.segmentation import grain_numbers
from driver.experiment.images.files import Refused
from driver.parameters.microstructure import ROTATION_SCALE
from meshes.arrays import FloatArray
from solver_adapters.crystal import bunge_angles, bunge_matrix

Stamp = tuple[int, int, int]


class OrientationError(InputError):
    """An EBSD map that cannot be used: file, key, what was found, what was expected."""


@dataclass(frozen=True, eq=False)
class GrainOrientation:
    """The measured orientation of a grain.

    Attributes:
        rotation: crystal → specimen, shape (3, 3). Columns are the crystal axes in the specimen
            frame: Q · V · Rz(φ1) · Rx(Φ) · Rz(φ2), with V from the frame of the Euler angles to
            the EBSD frame, and Q from there to the specimen frame.
        euler_deg: its Bunge angles φ1, Φ, φ2 [degrees], stated or those of the mean of the map.
        of_map: the grain of a map, None for stated angles.
    """

    rotation: FloatArray
    euler_deg: tuple[float, float, float]
    of_map: PickedGrain | None = None


def grain_orientations(case: Case) -> tuple[GrainOrientation, ...]:
    """Return the orientations of the grains of a case.

    Raises:
        OrientationError: a map cannot be used, or a pick meets no grain of it.
    """
    to_specimen, picked = case.orientation.from_euler_axes, _picked(case)
    found = []
    for number, grain in enumerate(case.grains):
        of_map = picked.get(number)
        if of_map is None:
            assert grain.euler_deg is not None  # a grain has angles or a map
            rotation, angles = bunge_matrix(*grain.euler_deg), grain.euler_deg
        else:
            rotation, angles = of_map.rotation, bunge_angles(of_map.rotation)
        found.append(GrainOrientation(to_specimen @ rotation, angles, of_map))
    return tuple(found)


def orientations_of(case: Case) -> FloatArray:
    """Crystal → specimen rotation of each grain of a case, shape (n_grains, 3, 3).

    Raises:
        OrientationError: a map cannot be used, or a pick meets no grain of it.
    """
    return np.array([grain.rotation for grain in grain_orientations(case)])


def rotation_scales(case: Case) -> dict[str, float]:
    """Prior scales [rad] of the turns of those grains whose maps spread more than is usual.

    The three components of a turn have spread/√3 each, so that the root mean square of its angle is
    the spread of the grain. It is never less than the scale without a map: that holds what a map
    cannot tell of itself, how well the system is calibrated and how the specimen was put in.

    Returns:
        Scale by the name of the parameter, of these grains alone.

    Raises:
        OrientationError: a map cannot be used, or a pick meets no grain of it.
    """
    scales: dict[str, float] = {}
    for number, grain in enumerate(grain_orientations(case), start=1):
        of_component = 0.0 if grain.of_map is None else grain.of_map.spread / 3**0.5
        if of_component > ROTATION_SCALE:
            scales |= {f"rotation_grain{number}_{axis}": of_component for axis in "xyz"}
    return scales


def map_files(case: Case) -> tuple[Path, ...]:
    """Return the EBSD maps that a case names, each once."""
    names = dict.fromkeys(grain.ebsd for grain in case.grains if grain.ebsd is not None)
    return tuple(case.path(name) for name in names)


def map_traces(case: Case) -> dict[int, MapTrace]:
    """Return the traces of grain boundaries on maps, by the number of the boundary from 0.

    They are looked at over the width of the specimen, where a map shows both grains side by side
    and the boundary between them is straight.

    Raises:
        OrientationError: a map cannot be used.
    """
    traces: dict[int, MapTrace] = {}
    for file in map_files(case):
        here, width = picks_of(case, file), case.specimen.width
        try:
            found = _traces(file, stamp_of(file), tuple(here.values()), width)
        except Refused as refused:
            key = f"grains.{min(here) + 1}.ebsd"
            raise OrientationError(sentence(file, key, refused.found, refused.expected)) from None
        traces |= {
            first: trace
            for (first, second), trace in zip(pairwise(here), found, strict=True)
            if second == first + 1 and trace is not None
        }
    return traces


def picks_of(case: Case, file: Path) -> dict[int, Pick]:
    """Return what picks grains in a map, by the number of the grain from 0."""
    along_y = case.orientation.rotation[1, :2]
    return {
        number: Pick(grain.ebsd_point_um, grain.ebsd_grain, (float(along_y[0]), float(along_y[1])))
        for number, grain in enumerate(case.grains)
        if grain.ebsd is not None and case.path(grain.ebsd) == file
    }


def _picked(case: Case) -> dict[int, PickedGrain]:
    """Return the grains that are picked in maps, by their number from 0; each map is read once."""
    picked: dict[int, PickedGrain] = {}
    for file in map_files(case):
        here = picks_of(case, file)
        try:
            grains = _read(file, stamp_of(file), tuple(here.values()))
        except Refused as refused:
            grains = (refused,) * len(here)
        for number, grain in zip(here, grains, strict=True):
            if isinstance(grain, Refused):
                key = f"grains.{number + 1}.ebsd"
                raise OrientationError(sentence(file, key, grain.found, grain.expected))
            picked[number] = grain
    return picked


def stamp_of(file: Path) -> Stamp:
    """Return what tells a file from the one that was there before.

    Raises:
        Refused: there is none.
    """
    try:
        status = file.stat()
    except FileNotFoundError:
        raise Refused("nothing", EXPECTED) from None
    except (OSError, ValueError) as error:
        raise Refused(why(error), EXPECTED) from None
    return status.st_ino, status.st_size, status.st_mtime_ns


@lru_cache(maxsize=4)
def _read(file: Path, stamp: Stamp, picks: tuple[Pick, ...]) -> tuple[PickedGrain | Refused, ...]:
    """Read grains of a map; the models of one run ask for them again and again."""
    points = read_map(file)
    numbers = grain_numbers(points)

    def grain(pick: Pick) -> PickedGrain | Refused:
        try:
            return picked_grain(points, numbers, pick)
        except Refused as refused:
            return refused.with_traceback(None)  # which would keep the whole map

    return tuple(map(grain, picks))


@lru_cache(maxsize=4)
def _traces(
    file: Path, stamp: Stamp, picks: tuple[Pick, ...], reach: float
) -> tuple[MapTrace | None, ...]:
    """Read the map once more for the boundaries between each pick and the next."""
    points = read_map(file)
    numbers = grain_numbers(points)
    grains = [members_of(points, numbers, pick) for pick in picks]
    traces = []
    for (start, first), (end, second) in pairwise(grains):
        ends = np.array([[points.x[at], points.y[at]] for at in (start, end)])
        traces.append(boundary_trace(points, first, second, ends, reach))
    return tuple(traces)

"""An EBSD map as a table of points, read by orix from the files of EDAX, Oxford and Bruker."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from driver.case.grains import EbsdFrame
from driver.common.errors import why
from driver.experiment.ebsd.headers import (
    ANG,
    CTF,
    HDF5,
    MOST_POINTS,
    Header,
    read_header,
    refuse_unfit_file,
)
from driver.experiment.ebsd.orix_library import compiled_apart
from driver.experiment.ebsd.text_faults import text_fault
from driver.experiment.images.files import Refused
from meshes.arrays import BoolArray, FloatArray, IntArray

CUBIC = "m-3m"
"""Laue class of the crystals whose law is known here."""
_NOT_INDEXED = -1
_FOUR_PI, _NEARLY = 4 * np.pi, 1e-3
_LONGEST = 160  # of what a file or its reader says in a sentence
_GRAIN_IDS = ("grainid", "grainids", "grain", "grains")
_MICROMETRES = {"um": 1.0, "µm": 1.0, "nm": 1e-3, "mm": 1e3}


@dataclass(frozen=True)
class Phase:
    """A phase of a map.

    Attributes:
        name: as the file calls it.
        laue: its Laue class, "" where the file tells none.
    """

    name: str
    laue: str


@dataclass(frozen=True, eq=False)
class EbsdMap:
    """Points of an EBSD map.

    Attributes:
        x, y: coordinates of the map [µm], shape (n,).
        rotations: unit quaternions (w, x, y, z) from the crystal to the frame of the Euler angles,
            shape (n, 4).
        phase: key of `phases`, −1 where a point was not indexed, shape (n,).
        phases: by their numbers.
        grain_ids: the grain of each point as the file counts them, shape (n,), or None.
        step: of the grid along x and y, as the header has it [µm], or None.
        surface: Euler angles of the acquired surface, of an Oxford file [degrees].
        like_radians: whether angles that the file has in degrees look like radians.
        makers: of the system whose software has written the file, none where that is not known.
    """

    x: FloatArray
    y: FloatArray
    rotations: FloatArray
    phase: IntArray
    phases: Mapping[int, Phase]
    grain_ids: IntArray | None = None
    step: tuple[float, float] | None = None
    surface: tuple[float, float, float] = (0.0, 0.0, 0.0)
    like_radians: bool = False
    makers: tuple[EbsdFrame, ...] = ()

    @property
    def indexed(self) -> BoolArray:
        """Whether a point was indexed, shape (n,)."""
        return np.asarray(self.phase != _NOT_INDEXED)

    @property
    def cubic(self) -> BoolArray:
        """Whether a point was indexed as a cubic crystal of class m-3m, shape (n,)."""
        known = [key for key, phase in self.phases.items() if phase.laue == CUBIC]
        return np.asarray(self.indexed & np.isin(self.phase, known))


def read_map(file: Path) -> EbsdMap:
    """Read an EBSD map.

    Args:
        file: an .ang file, a .ctf file, or an HDF5 file of Bruker, EMsoft or orix.

    Raises:
        Refused: there is no such file, orix is not there, the file is damaged, too large, or
            mirrored, or holds no point that was indexed.
    """
    refuse_unfit_file(file)
    suffix = file.suffix.lower()
    header = Header() if suffix in HDF5 else read_header(file)
    crystal_map = _loaded(file)
    try:
        points = _points(
            crystal_map, header, _marked(file), suffix == CTF or _of_bruker(crystal_map)
        )
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise Refused(_said(error), _whole(file)) from None
    _refuse_unusable(points, header)
    return points


def _loaded(file: Path) -> Any:
    """Return what orix reads."""
    try:
        with compiled_apart():
            import quaternion  # noqa: F401, without which orix takes functions that may crash
            from orix import crystal_map  # noqa: F401, which its readers would import later
            from orix.io import load
    except ImportError as error:
        absent = f"no library {error.name}, with which it is read"
        raise Refused(absent, '`pip install "prismid[ebsd]"` before') from None
    named = {"autogen_names": False} if file.suffix.lower() == ANG else {}
    try:
        with warnings.catch_warnings():
            # What orix guesses of more columns than it knows holds for the first eight of them.
            warnings.simplefilter("ignore")
            return load(file, **named)
    except Exception as error:  # its readers raise what their parts raise
        raise _fault(file, error) from None


def _fault(file: Path, error: BaseException) -> Refused:
    """Return what is wrong with a file that cannot be read, in the words of its reader at last."""
    known = None if file.suffix.lower() in HDF5 else text_fault(file)
    return known or Refused(_said(error), _whole(file))


def _whole(file: Path) -> str:
    suffix = file.suffix.lower()
    if suffix in HDF5:
        return "an HDF5 file of Bruker, EMsoft or orix that is whole; of others, an export as .ang"
    return f"an {ANG} file that is whole" if suffix == ANG else f"a {CTF} file that is whole"


def _said(error: BaseException) -> str:
    """Return what a reader said, of which it may have quoted any length."""
    return f"“{_cut(why(error).strip('“”'))}”"


def _cut(text: str) -> str:
    line = " ".join(text.split())
    return line if len(line) <= _LONGEST else line[: _LONGEST - 1] + "…"


def _of_bruker(crystal_map: Any) -> bool:
    return "MADPhase" in crystal_map.prop


def _marked(file: Path) -> BoolArray | None:
    """Points of an .ang file that EDAX marks as not indexed, by angles of 4π or confidence −1.

    Raises:
        Refused: its angles are in degrees.
    """
    if file.suffix.lower() != ANG:
        return None
    try:
        columns = np.loadtxt(file, usecols=(0, 1, 2, 6), ndmin=2)
    except (ValueError, OSError) as error:
        raise _fault(file, error) from None
    angles = columns[:, :3]
    marked = (np.abs(angles - _FOUR_PI) < _NEARLY).all(axis=1) | (columns[:, 3] == -1.0)
    largest = np.abs(angles[~marked]).max(initial=0.0)
    if largest > _FOUR_PI + _NEARLY:
        raise Refused(f"Euler angles up to {largest:g}", "radians, as an .ang file has them")
    return np.asarray(marked)


def _points(crystal_map: Any, header: Header, marked: BoolArray | None, degrees: bool) -> EbsdMap:
    unit = str(crystal_map.scan_unit)
    if unit not in _MICROMETRES:
        raise Refused(f"coordinates in “{unit}”", "micrometres")
    micrometres = _MICROMETRES[unit]
    n = int(crystal_map.size)
    x, y = (
        np.zeros(n) if values is None else np.asarray(values, dtype=np.float64) * micrometres
        for values in (crystal_map.x, crystal_map.y)
    )
    # Several solutions of a point stand by their likeness. orix turns the sample to the crystal.
    best = np.asarray(crystal_map.rotations.data, dtype=np.float64).reshape(n, -1, 4)[:, 0]
    phase = np.asarray(crystal_map.phase_id, dtype=np.int64).reshape(n, -1)[:, 0].copy()
    if marked is not None:
        phase[marked] = _NOT_INDEXED
    ids = next(
        (values for name, values in crystal_map.prop.items() if _plain(name) in _GRAIN_IDS), None
    )
    step = header.step
    return EbsdMap(
        x=x,
        y=y,
        rotations=best * [1.0, -1.0, -1.0, -1.0],
        phase=phase,
        phases={
            int(key): Phase(
                _cut(str(one.name)), one.point_group.laue.name if one.point_group else ""
            )
            for key, one in crystal_map.phases
            if key != _NOT_INDEXED
        },
        grain_ids=None if ids is None else np.asarray(ids).reshape(n, -1)[:, 0].astype(np.int64),
        step=None if step is None else (step[0] * micrometres, step[1] * micrometres),
        surface=header.surface,
        like_radians=degrees and _like_radians(crystal_map, phase != _NOT_INDEXED),
        makers=("bruker",) if _of_bruker(crystal_map) else header.makers,
    )


def _plain(name: str) -> str:
    return name.lower().replace("_", "").replace(" ", "")


def _like_radians(crystal_map: Any, indexed: BoolArray) -> bool:
    """Whether all angles of a map in degrees are small enough to be radians, and not all zero."""
    if not indexed.any():
        return False
    degrees = np.asarray(crystal_map.rotations[indexed].to_euler(degrees=True)).reshape(-1, 3)
    # Where Φ is 0 only the sum of the others is known.
    about_z = (degrees[:, 0] + degrees[:, 2]) % 360.0
    largest = max(about_z.max() / 2, degrees[:, 1].max() * 2)
    return bool(_NEARLY < largest <= 2 * np.pi + _NEARLY)


def _refuse_unusable(points: EbsdMap, header: Header) -> None:
    n = points.x.size
    if n > MOST_POINTS:
        raise Refused(f"{n:.3g} points", f"at most {MOST_POINTS:.0e}")
    if n < header.points:
        raise Refused(
            f"{n} points, but {header.points} by its header", "a file that is whole: export it anew"
        )
    numbers = (points.x, points.y, *points.rotations[points.indexed].T)
    if not all(np.isfinite(values).all() for values in numbers):
        raise Refused("coordinates or angles that are no numbers", "numbers")
    _refuse_mirrored(points)
    if not points.indexed.any():
        raise Refused(f"{n} points, none of them indexed", "a map with orientations")


def _refuse_mirrored(points: EbsdMap) -> None:
    """Refuse coordinates that fall from point to point, in a file whose grid goes along +x and +y.

    A program has flipped the map after the measurement, and left its angles as they were.
    """
    if points.step is None:
        return
    along_x = np.diff(points.x)
    within, between = along_x[np.diff(points.y) == 0], np.diff(points.y)
    between = between[between != 0]
    for axis, steps in (("x", within), ("y", between)):
        if steps.size and np.mean(steps < 0) > 0.5:
            raise Refused(
                f"{axis} that falls from point to point on a grid of positive steps, so that its "
                "coordinates are mirrored and its angles are not",
                "a right-handed map: it is exported anew, not flipped",
            )

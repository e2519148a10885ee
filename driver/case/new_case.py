"""The case that `prismid init` writes, with the files that its user names."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

from driver.case.grains import OF_THE_FACE, EbsdFrame, Grain, Orientation
from driver.case.history import HistoryTable
from driver.case.images import Images
from driver.case.material import Crystal
from driver.case.model import Case, CaseError, default_case
from driver.case.specimen import Shape
from driver.common.errors import sentence


@dataclass(frozen=True)
class NewFiles:
    """Names of files as the case has them, seen from its folder; None for the usual ones.

    Attributes:
        frames: height maps of the test.
        repeats: those of the unloaded specimen.
        flats: those of a flat surface.
        history: the log.
        ebsd: EBSD map of both grains; None for Bunge angles.
        noise_nm: noise of a pixel, by which repeats that are not named are left out.
    """

    frames: str | None = None
    repeats: str | None = None
    flats: str | None = None
    history: str | None = None
    ebsd: str | None = None
    noise_nm: float | None = None


def new_case(
    path: Path,
    files: NewFiles,
    crystal: Crystal = "bcc",
    shape: Shape = "prism",
    ebsd_frame: EbsdFrame | None = None,
) -> Case:
    """Return the default case with these files.

    A map is taken for one of the measured face, its rows along the loading axis: no file says so,
    and the lines above what states it ask for it.

    Flats that are not named are left out where frames are: of another kind of file the heights
    are of another kind, too. Repeats that are not named are left out where the noise is stated.

    Args:
        path: the case file that is to be written.
        files: what it names.
        crystal: whose slip systems and constants it has.
        shape: of the specimen.
        ebsd_frame: of the Euler angles of its map, where it is known.

    Raises:
        CaseError: a name is empty, or the noise no number above 0.
        InputError: an installed term of the user's own cannot be used.
    """
    for field in fields(files):
        if getattr(files, field.name) == "":
            raise CaseError(sentence(path, f"--{field.name}", "nothing", "the name of a file"))
    noise, repeats = files.noise_nm, files.repeats
    if noise is not None and not 0 < noise < np.inf:
        raise CaseError(sentence(path, "--noise-nm", f"{noise:g}", "a number > 0"))
    case = default_case(crystal, shape)
    of_case: dict[str, object] = {}
    if files.frames or repeats or files.flats or noise is not None:
        of_case["images"] = Images(
            frames=files.frames or case.images.frames,
            repeats=repeats or (case.images.repeats if noise is None else None),
            noise_nm=case.images.noise_nm if noise is None else noise,
            flats=files.flats or (None if files.frames else case.images.flats),
        )
    if files.history:
        of_case["history"] = HistoryTable(file=files.history)
    if files.ebsd:
        of_case["grains"] = tuple(Grain(name=g.name, ebsd=files.ebsd) for g in case.grains)
        of_case["orientation"] = Orientation(ebsd_frame=ebsd_frame, ebsd_to_specimen=OF_THE_FACE)
    return case.model_copy(update=of_case)

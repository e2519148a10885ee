"""Files and folders that a case names, under other names: it may be written elsewhere."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from driver.case.model import Case
from driver.case.solver import ProfileTable
from driver.case.solver_profiles import with_files_of

TRACE = "trace"
"""The mesh of a correlation that is no file: the trace of the working mesh on the face."""
_OF_IMAGES = ("frames", "flats", "repeats", "mask", "noise_map")
_OF_SPECIMEN = ("mesh_file", "labels")
_OF_DIC = ("mesh", "height_mesh")


def with_file_names(case: Case, renamed: Callable[[str], str]) -> Case:
    """Return the case with other names of all files and folders that it names.

    Args:
        case: the case.
        renamed: takes a name, as the case has it, and returns the new one.
    """
    images = {
        key: renamed(name) for key in _OF_IMAGES if (name := getattr(case.images, key)) is not None
    }
    meshes = {
        key: renamed(name)
        for key in _OF_DIC
        if (name := getattr(case.dic, key)) is not None and name != TRACE
    }
    causes = tuple(map(renamed, case.diagnosis.cause_files))
    profiles = _renamed_profiles(case, renamed)
    grains = tuple(
        grain if grain.ebsd is None else grain.model_copy(update={"ebsd": renamed(grain.ebsd)})
        for grain in case.grains
    )
    specimen = {
        key: renamed(name)
        for key in _OF_SPECIMEN
        if (name := getattr(case.specimen, key)) is not None
    }
    store = {} if case.execution.store is None else {"store": renamed(case.execution.store)}
    return case.model_copy(
        update={
            "specimen": case.specimen.model_copy(update=specimen),
            "grains": grains,
            "images": case.images.model_copy(update=images),
            "dic": case.dic.model_copy(update=meshes),
            "history": case.history.model_copy(update={"file": renamed(case.history.file)}),
            "diagnosis": case.diagnosis.model_copy(update={"cause_files": causes}),
            "solver": case.solver.model_copy(update={"profiles": profiles}),
            "execution": case.execution.model_copy(update=store),
        }
    )


def read_from(case: Case, folder: Path) -> Case:
    """Return the case with names that lead to its files from another folder."""
    above = os.path.relpath(case.path("").resolve(), folder.resolve())

    def renamed(name: str) -> str:
        return name if Path(name).is_absolute() else f"{above}/{name}"

    return with_file_names(case, renamed)


def _renamed_profiles(case: Case, renamed: Callable[[str], str]) -> dict[str, ProfileTable]:
    """Return the profiles of the case, whose commands may name files beside it."""
    profiles = dict(case.solver.profiles)
    for name, profile in profiles.items():
        if profile.command is not None:
            resolved = with_files_of(case.path(""), profile.command)
            words = (
                renamed(word) if word != there else word
                for word, there in zip(profile.command, resolved, strict=True)
            )
            profiles[name] = profile.model_copy(update={"command": tuple(words)})
    return profiles

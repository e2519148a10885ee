"""The case that a diagnosis ends with: its causes freed, its noise stated, its starts fitted.

What the diagnosis left out of the loads stays out of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile

from driver.case.material import MaterialTable
from driver.case.model import Case
from driver.case.solver import ProfileTable
from driver.case.solver_profiles import with_files_of
from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import half_turn
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.experiment.reading import as_in_files
from driver.forward.build import TRACE
from driver.parameters.boundary import LAMBDAS
from driver.parameters.covariance import NOISE_RATIO, SIGMA_E
from driver.parameters.registry import declared_parameters
from driver.results.files import NOISE_MAP, RESULTS
from solver_adapters.material import declarations_at


def extended_case(case: Case, found: Diagnosis) -> Case:
    """Return the case with the fitted values as starts and the added causes freed.

    It stands in `results/`: its paths lead one folder up, or are absolute where that is a link.
    """
    values = found.extended.values
    declared = declared_parameters(1)
    stated = {
        declared[name].key: values[name] for name in (*case.identification.parameters, *LAMBDAS)
    }
    if SIGMA_E.name in found.levels:
        stated[SIGMA_E.key] = SIGMA_E.reading[0] * found.levels[SIGMA_E.name][0]
    started = with_half_turns(case.with_values_at(stated), found.causes)
    freed = {
        name: _within_bounds(name, values[name], started.material)
        for name in (*case.extensions, *added_parameters(found))
    }
    images = case.images
    moved = {
        key: _from_results(case, getattr(images, key))
        for key in ("frames", "flats", "repeats", "mask", "noise_map")
        if getattr(images, key) is not None
    }
    if NOISE_RATIO.name in found.levels:
        moved["noise_map"] = NOISE_MAP
    history = case.history.model_copy(update={"file": _from_results(case, case.history.file)})
    wrong = {*case.loads.left_out, *(bad.frame for bad in found.bad_loads)}
    files = tuple(_from_results(case, name) for name in case.diagnosis.cause_files)
    meshes = {
        key: _from_results(case, name)
        for key in ("mesh", "height_mesh")
        if (name := getattr(case.dic, key)) is not None and name != TRACE
    }
    return started.model_copy(
        update={
            "loads": case.loads.model_copy(update={"left_out": tuple(sorted(wrong))}),
            "extensions": freed,
            "images": images.model_copy(update=moved),
            "dic": case.dic.model_copy(update=meshes),
            "solver": case.solver.model_copy(update={"profiles": _profiles_from_results(case)}),
            "history": history,
            "diagnosis": case.diagnosis.model_copy(update={"cause_files": files}),
        }
    )


def _within_bounds(name: str, value: float, material: MaterialTable) -> float:
    """Return a start within its bounds, which for a back stress hang on the d that was found."""
    declared = {p.name: p for p in declarations_at(material.to_material())}
    if name not in declared:
        return value
    return min(max(value, declared[name].lower), declared[name].upper)


def added_parameters(found: Diagnosis) -> tuple[str, ...]:
    """Names of the parameters of the general model that the extension freed.

    A companion that was fitted before is none of them.
    """
    freed = [cause for cause in found.causes if cause not in COVARIANCE]
    every = (n for cause in freed for n in (*cause.parameters, *cause.companions))
    return tuple(name for name in dict.fromkeys(every) if name not in found.baseline.best.free)


def with_half_turns(case: Case, causes: Sequence[Cause]) -> Case:
    """Return the case with its EBSD frame turned as those of the causes that are flips turn it."""
    given = np.array(case.orientation.ebsd_to_specimen)
    rows = tuple(map(tuple, (half_turn(causes) @ given + 0.0).tolist()))
    return case.model_copy(
        update={"orientation": case.orientation.model_copy(update={"ebsd_to_specimen": rows})}
    )


def write_noise_map(case: Case, found: Diagnosis, path: Path) -> None:
    """Write the noise of each pixel over its mean, as an image like those of the case."""
    image = found.objective.data.image
    noise = np.ones((1, *image.images.shape))
    if image.variance is not None:
        noise[0, image.images.rows, image.images.cols] = np.sqrt(image.variance)
    tifffile.imwrite(path, as_in_files(case.images, noise)[0].astype(np.float32))


def _profiles_from_results(case: Case) -> dict[str, ProfileTable]:
    """Return the profiles of the case, whose commands may name files beside it."""
    moved = dict(case.solver.profiles)
    for name, profile in moved.items():
        if profile.command is not None:
            resolved = with_files_of(case.path(""), profile.command)
            words = (
                _from_results(case, word) if word != there else word
                for word, there in zip(profile.command, resolved, strict=True)
            )
            moved[name] = profile.model_copy(update={"command": tuple(words)})
    return moved


def _from_results(case: Case, name: str) -> str:
    if Path(name).is_absolute():
        return name
    if not case.path(RESULTS).is_symlink():
        return f"../{name}"
    # One folder up from where a link leads is not the folder of the case.
    return str(case.path("").resolve() / name)

"""The case that a diagnosis ends with: its causes freed, its noise stated, its starts fitted.

What the diagnosis left out of the loads stays out of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tifffile

from driver.case.file_names import with_file_names
from driver.case.model import Case
from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.ebsd_flips import frame_turn
from driver.diagnosis.causes.noise_causes import COVARIANCE
from driver.experiment.reading import as_in_files
from driver.parameters.boundary import LAMBDAS
from driver.parameters.covariance import NOISE_RATIO, SIGMA_E
from driver.parameters.registry import declared_parameters
from driver.results.files import NOISE_MAP, RESULTS, results_of
from solver_adapters.material import declarations_at


def extended_case(case: Case, found: Diagnosis) -> Case:
    """Return the case with the fitted values as starts and the added causes freed.

    It stands in `results/`: its paths lead one folder up, or are absolute where that is a link.
    """
    values = found.extended.values
    declared = declared_parameters(1, n_grains=len(case.grains))
    stated = {
        declared[name].key: values[name] for name in (*case.identification.parameters, *LAMBDAS)
    }
    if SIGMA_E.name in found.levels:
        stated[SIGMA_E.key] = SIGMA_E.reading[0] * found.levels[SIGMA_E.name][0]
    started = with_frame_turns(case.with_values_at(stated), found.causes)
    freed = {
        name: _within_bounds(name, values[name], started)
        for name in (*case.extensions, *added_parameters(found))
    }
    moved = with_file_names(started, lambda name: _from_results(case, name))
    moved = moved.with_values_at({"execution.results": RESULTS})
    images = {"noise_map": NOISE_MAP} if NOISE_RATIO.name in found.levels else {}
    wrong = {*case.loads.left_out, *(bad.frame for bad in found.bad_loads)}
    return moved.model_copy(
        update={
            "loads": case.loads.model_copy(update={"left_out": tuple(sorted(wrong))}),
            "extensions": freed,
            "images": moved.images.model_copy(update=images),
        }
    )


def _within_bounds(name: str, value: float, case: Case) -> float:
    """Return a start within its bounds, which for a back stress hang on the d that was found."""
    declared = {p.name: p for p in declarations_at(case.material.to_material(), len(case.grains))}
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


def with_frame_turns(case: Case, causes: Sequence[Cause]) -> Case:
    """Return the case with its EBSD frame turned as those of the causes that are flips turn it."""
    given = np.array(case.orientation.ebsd_to_specimen)
    rows = tuple(map(tuple, (frame_turn(causes) @ given + 0.0).tolist()))
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


def _from_results(case: Case, name: str) -> str:
    if Path(name).is_absolute():
        return name
    results = results_of(case)
    if results.parent == case.path("") and not results.is_symlink():
        return f"../{name}"
    # One folder up from where a link leads is not the folder of the case.
    return str(case.path("").resolve() / name)

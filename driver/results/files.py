"""Names of all files and folders that are written for a case, and what each holds.

The case file and its schema are named by `driver.case.model`, which reads them.
"""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path
from tempfile import TemporaryFile

from driver.case.consent import Request, refuse_unless_agreed
from driver.case.model import Case
from driver.common.atomic_write import refuse_link
from driver.common.errors import InputError, sentence, why

# Of a run.
RESULTS = "results"
"""The folder of the results, beside the case, unless the case names another one."""
STAGES = "stages.json"
"""Which stages are finished, for which inputs, with which results."""
LOCK = "run.lock"
"""Whose run is at work on the results."""
FAULT = "fault.log"
"""The traceback of a fault of prismid that has ended a run."""
JOBS = "jobs"
"""The folder of the jobs of a solver that is a program of its own, unless the case names one."""
READ_BACK = (".h5", ".json", ".med")
"""Endings of results that later stages read."""

SIZES = "sizes.json"
"""How often meshes of automatic sizes were refined, and the time that the coarser ones took."""

# Stage mesh.
MESH, MESH_VTU = "mesh.med", "mesh.vtu"
"""The working mesh, for solvers and for ParaView; an export has the latter, too."""
FINE_MESH, FINE_MESH_VTU = "mesh_fine.med", "mesh_fine.vtu"
"""The finer mesh behind the correction."""

# Stage measure.
MEASURE, MEASURE_CSV = "measure.h5", "measure.csv"
"""The motion of the face by free correlation, and an image a row."""
MEASURE_REFERENCE = "measure_reference.png"
"""Picture of the reference, the region of interest and the meshes."""
MEASURE_FIELDS = "measure_fields.png"
"""Picture of u, v, w at the ends of loading."""
MEASURE_TRAVEL = "measure_travel.png"
"""Picture of elongation, tilt and mean of w over stage travel."""
MEASURE_GRIP = "measure_grip.png"
"""Picture of the elongation beside the line of all images."""
MEASURE_RESIDUALS = "measure_residuals.png"
"""Picture of the residuals of the images."""
MEASURE_NOISE = "measure_noise.png"
"""Picture of the residuals over their noise."""

# Stage identify.
IDENTIFY, IDENTIFY_CSV = "identify.h5", "identify.csv"
"""Parameters, covariance and predictions, and a parameter a row."""
HISTORY_JSON = "identify_history.json"
"""The iterations of the identification."""

# Stage diagnose.
DIAGNOSIS, DIAGNOSIS_H5 = "diagnosis.json", "diagnosis.h5"
"""The verdict with the evidence of every cause, and predictions before and after."""
EXTENDED = "extended.toml"
"""The case with the causes that were added."""
NOISE_MAP = "noise_map.tif"
"""Noise of each pixel over its mean."""
DECKS = "extended_decks"
"""The folder of the extended model as decks, one folder a solver."""

# Stage advise.
ADVICE = "advice.json"
"""Which change of the experiment would part a set of causes."""

# Stage report.
REPORT, REPORT_CSV = "report.html", "report_parameters.csv"
"""The report page, and the parameters of the final model, one a row."""

# Other verbs, into the same folder.
CHECK_PICTURE = "check.png"
"""The specimen over the first image."""
NOISE_FLOOR, NOISE_FLOOR_CSV = "noise_floor.json", "noise_floor.csv"
"""Errors of the correlation against mesh size, and a mesh a row."""
NOISE_FLOOR_PICTURE = "noise_floor.png"
"""Picture of the same."""
DESIGN, DESIGN_PICTURE = "design.json", "design.png"
"""What an experiment would say, and its picture."""

POSTERIOR, POSTERIOR_DRAWS = "posterior.csv", "posterior_draws.csv"
"""Moments of the posterior by sampling, and the draws with their weights."""

# An export.
EXPORT = "export"
"""The folder of an export, among the results unless another one is given."""
README = "README.txt"
"""What the files of an export hold, and their list."""
SURFACE_SERIES, SURFACE_FRAMES = "surface.pvd", "surface"
"""The measured face over time, and the folder of its images."""
LOADS_CSV = "loads.csv"
"""Measured and predicted load, an image a row."""
IMAGES_CSV = "images.csv"
"""Elongation, tilt and rigid motion, an image a row."""
KNOTS_CSV = "knots.csv"
"""The boundary motion, a turning point a row."""
PARAMETERS_CSV = "parameters.csv"
"""All other parameters, one a row."""

# A virtual experiment.
IMAGES_TIF, REPEATS_TIF, FLATS_TIF = "images.tif", "repeats.tif", "flats.tif"
"""The stacks of height maps."""
LABELS_TIF = "labels.tif"
"""The grain at each pixel, where the case has a label image."""
HISTORY_CSV = "history.csv"
"""Times, stage travel, images and their loads."""
TRUTH, TRUTH_H5 = "truth.json", "truth.h5"
"""The true parameters, and the true motion, load, relief and noise."""


# A campaign, all in a folder beside its file.
SUMMARY_CSV, SUMMARY_HTML = "summary.csv", "summary.html"
"""A case a row, and the page that compares them."""
BATCH = ".batch"
"""Ending of that folder."""
TRUTH_SETTINGS = "settings.toml"
"""Copy of the settings that virtual experiments are made from."""


def batch_folder(campaign: Path) -> Path:
    """Return the folder of the summary, the logs and the cases that a campaign writes."""
    return campaign.with_suffix(BATCH)


def refuse_links_of_batch(campaign: Path) -> None:
    """Refuse a campaign whose folder holds links, through which others' files would be written.

    Raises:
        InputError: one of them.
    """
    for pattern in ("*", "logs/*", "truths/*"):
        for place in sorted(batch_folder(campaign).glob(pattern)):
            refuse_link(place)


def batch_log(campaign: Path, job: str) -> Path:
    """Return the file of what a job of a campaign says."""
    return batch_folder(campaign) / "logs" / f"{job}.log"


def batch_workers(campaign: Path) -> Path:
    """Return the folder of what the workers of a campaign say that a queue system has started."""
    return batch_folder(campaign) / "workers"


def batch_lock(campaign: Path, job: str) -> Path:
    """Return the file that is locked as long as a process of a job of a campaign lives."""
    return batch_folder(campaign) / "logs" / f"{job}.lock"


def batch_made_from(campaign: Path, job: str) -> Path:
    """Return the file of the hash of what a virtual experiment of a campaign was made from."""
    return batch_folder(campaign) / "logs" / f"{job}.sha256"


def batch_truth(campaign: Path, digest: str) -> Path:
    """Return the folder of the case and the settings that virtual experiments are made from."""
    return batch_folder(campaign) / "truths" / digest


def batch_token(campaign: Path, run: str) -> Path:
    """Return the file that is there as long as the jobs of a run of a campaign may go on."""
    return batch_folder(campaign) / f"running-{run}"


def results_of(case: Case) -> Path:
    """Return the folder of the results of a case: beside its file, or the one that is asked for."""
    return case.path(case.execution.results)


def with_results(case: Case, folder: Path | None) -> Case:
    """Return a case whose results go into a folder; None leaves them where they are."""
    if folder is None:
        return case
    return case.with_values_at({"execution.results": os.path.abspath(folder)})


def job_store(case: Case) -> Path:
    """Return the folder of the jobs of a solver that is a program of its own."""
    stated = case.execution.store
    return results_of(case) / JOBS if stated is None else case.path(stated)


def make_job_store(folder: Path, file: Path) -> None:
    """Make the folder of the jobs that `execution.store` names, where there is none yet.

    Args:
        folder: the folder.
        file: of the case or the campaign that names it.

    Raises:
        InputError: it cannot be made, or nothing can be written there.
    """
    expected = "a folder that can be made and written"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except (OSError, ValueError) as error:
        reason = "a file or a link to nothing" if isinstance(error, FileExistsError) else why(error)
        found = f"{json.dumps(str(folder), ensure_ascii=False)} ({reason})"
        raise InputError(sentence(file, "execution.store", found, expected)) from None


def make_folder(results: Path, file: Path) -> None:
    """Make the folder of the results, where there is none yet.

    Args:
        results: the folder.
        file: of the case or the campaign whose results they are.

    Raises:
        ConsentError: it is a link that the user has not agreed to.
        InputError: there is something else, or it cannot be made; its folder of jobs is elsewhere.
    """
    if results.is_symlink() and not results.exists():
        target = f"a link to {results.readlink()}, which is not there"
        raise InputError(sentence(results, "folder", target, "a folder, or a link to one"))
    refuse_unless_agreed(file, link_requests(results))
    refuse_link(results / JOBS)
    try:
        results.mkdir(exist_ok=True)
    except OSError as error:
        expected = "a folder that can be made and written"
        raise InputError(sentence(results, "folder", why(error), expected)) from None


def link_requests(folder: Path) -> list[Request]:
    """Return what a folder asks for that is a link: to write where that leads."""
    if not folder.is_symlink():
        return []
    return [Request(folder.name, "a link", (str(folder.resolve()),))]


def remove_folder(folder: Path) -> None:
    """Remove a folder if there is one; of a link what it leads to stays."""
    if folder.is_symlink():
        folder.unlink()
    shutil.rmtree(folder, ignore_errors=True)


def working_folder(stage: str) -> str:
    """Return the name of the folder in which a stage works."""
    return f"{stage}.partial"


def kept_folder(stage: str) -> str:
    """Return the name of the folder of what a stage that is at work keeps against interruptions."""
    return f"{stage}.kept"


def kept_response(folder: Path, key: str) -> Path:
    """Return the file of the response of a simulation in that folder."""
    return folder / f"{key}.npz"


def edited(path: Path, number: int) -> Path:
    """Return the path under which an edited result is kept; those after the first have a number."""
    return path.with_stem(f"{path.stem}.edited{number or ''}")


def report_figure(name: str) -> str:
    """Return the file name of a figure of the report page."""
    return f"report_{name}.png"


def vector_figure(name: str, kind: str) -> str:
    """Return the file name of the same as "pdf" or "svg", where those are asked for."""
    return f"{name}.{kind}"


def surface_frame(image: int) -> str:
    """Return the path of the measured face at an image in an export."""
    return f"{SURFACE_FRAMES}/surface_{image:04d}.vtu"


def volume_vtkhdf(model: str) -> str:
    """Return the file name of the volume of a model in an export, for ParaView."""
    return f"volume_{model}.vtkhdf"


def volume_med(model: str) -> str:
    """Return the file name of the volume of a model in an export, for Salome."""
    return f"volume_{model}.med"


class AbsentError(InputError):
    """A result of an earlier stage that is not there."""


def present(results: Path, name: str) -> Path:
    """Return the file of a result of an earlier stage.

    Raises:
        AbsentError: there is no such file.
    """
    path = results / name
    if not path.is_file():
        raise AbsentError(f"{path}: found nothing, expected the result of an earlier stage")
    return path

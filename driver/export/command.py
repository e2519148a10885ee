"""Results for other programs: the measured face and the volume for ParaView, tables as CSV."""

from __future__ import annotations

import logging
import os
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from socket import gethostname

import psutil

from driver.case.consent import refuse_unless_agreed
from driver.case.model import Case
from driver.common.atomic_write import place_below, refuse_link
from driver.common.errors import InputError, sentence
from driver.experiment.history import History, read_history
from driver.export.readme import exported_files, write_readme
from driver.export.surface import aligned, write_surface
from driver.export.volume import offers_volume, volume_files, write_volumes
from driver.forward.build import capabilities_of
from driver.parameters.boundary import elongation_names, tilt_names
from driver.results.files import (
    IMAGES_CSV,
    KNOTS_CSV,
    LOADS_CSV,
    MESH_VTU,
    PARAMETERS_CSV,
    README,
    STAGES,
    SURFACE_SERIES,
    job_store,
    link_requests,
    results_of,
)
from driver.results.hdf5 import write_csv
from driver.results.mesh_sizes import sized_case
from driver.results.reader import FinishedResults, FittedModel, read_results
from driver.results.stage_record import read_record
from driver.workflow.engine import finished
from driver.workflow.pipeline import stages
from meshes.arrays import FloatArray
from meshes.files import write_vtu
from solver_adapters.jobs.errors import CommandMissingError
from solver_adapters.kernels import use_threads

logger = logging.getLogger(__name__)


_NEEDED, _OPTIONAL = ("mesh", "measure", "identify"), "diagnose"


class ExportError(InputError):
    """Results that cannot be exported: what was found and what was expected."""


def export_case(
    case_path: Path,
    folder: Path,
    volume: bool = True,
    med: bool = False,
    results_folder: Path | None = None,
) -> None:
    """Write the finished results of a case in the formats of other programs.

    The folder is made if need be. Files that its README.txt lists as those of an earlier export
    are replaced, each of them whole, or removed; other files are left alone. Without a finished
    diagnosis of the case as it is, what belongs to the extended model is left out. The fields of
    the volume are no results of a run: each model is simulated once more for them, and they are
    left out where the program of the solver is absent.

    Args:
        case_path: the case file.
        folder: where to write.
        volume: whether to write the fields of the volume, where the solver answers them.
        med: whether to write them as MED, too.
        results_folder: folder of the results, None for that of the case.

    Raises:
        CaseError: the case cannot be used.
        ExportError: the case has no images, a stage has no results for the case as it is, or the
            folder cannot take them.
        ResultError: a result file cannot be read.
        SolverError: a simulation for the volume could not be finished.
    """
    if med and not volume:
        raise ExportError("--med: found --no-volume, expected --volume: MED holds its fields")
    case = sized_case(case_path, results_folder)
    if not case.with_images:
        expected = '"images": the fields that are exported are those of images and models'
        raise ExportError(sentence(case_path, "boundary.motion", '"stage"', expected))
    use_threads(case.execution.processes * case.execution.threads)
    results = _finished_results(case)
    if not results.diagnosed:
        logger.info("no extended model: there is no diagnosis of the case as it is")
    history = read_history(case.path(case.history.file), stated=case.history)
    _make_folder(folder, case)
    _remove_what_was_left(folder)
    with tempfile.TemporaryDirectory(prefix=f"{_aside()}{os.getpid()}-", dir=folder) as aside:
        written = Path(aside)
        write_surface(written, results.measured, results.models, case.boundary.gauge == "rigid")
        write_vtu(results.mesh, written / MESH_VTU)
        _write_tables(written, results, history)
        if volume and not offers_volume(case):
            logger.info(f"no fields of the volume: the solver {case.solver.name} answers none")
            volume = False
        _refuse_foreign(folder, [*_names(written), Path(README)])
        if volume:
            # Told before the simulations, which take their time.
            _refuse_foreign(folder, _volume_names(results, med))
            workspace = capabilities_of(case).uses_workspace
            jobs = job_store(case) if workspace else None
            volume = _write_volume(written, case, results, history, med, jobs)
        names = [*_names(written), Path(README)]
        write_readme(written / README, case_path, results.diagnosed, volume, volume and med, names)
        _refuse_foreign(folder, names)
        _move(written, folder)
    logger.info(f"{folder}: {len(names)} files, {README} says what they hold")


def _aside() -> str:
    """Return how the names of folders begin in which processes of this machine write."""
    return f"partial-{gethostname()}-"


def _remove_what_was_left(folder: Path) -> None:
    """Remove what exports of this machine have left that were killed."""
    for left in folder.glob(f"{_aside()}*"):
        process = left.name.removeprefix(_aside()).partition("-")[0]
        if process.isdecimal() and not psutil.pid_exists(int(process)):
            shutil.rmtree(left, ignore_errors=True)


def _finished_results(case: Case) -> FinishedResults:
    """Return the results of the case as it is.

    Raises:
        ExportError: a stage has none, or a run replaces them.
        ResultError: one of them cannot be read.
    """
    folder = results_of(case)
    record = read_record(folder)
    done = finished(case, stages(case), _NEEDED, ExportError)
    results = read_results(folder, diagnosed=_OPTIONAL in done)
    if read_record(folder) != record:
        replaced, expected = "a run that replaces results", "one that has ended: export again"
        raise ExportError(sentence(folder, STAGES, replaced, expected))
    return results


def _volume_names(found: FinishedResults, med: bool) -> list[Path]:
    return [Path(name) for model in found.models for name in volume_files(model.label, med)]


def _write_volume(
    written: Path,
    case: Case,
    found: FinishedResults,
    history: History,
    med: bool,
    jobs: Path | None,
) -> bool:
    """Whether the program of the solver was there to answer the fields of the volume."""
    try:
        write_volumes(written, case, found.mesh, history, found.models, med, jobs)
    except CommandMissingError as error:
        logger.info(
            f"no fields of the volume: {error.adapter}: {error.detail or error.status} "
            "(--no-volume leaves them out unasked)"
        )
        for name in _volume_names(found, med=True):
            (written / name).unlink(missing_ok=True)
        return False
    return True


def _write_tables(folder: Path, found: FinishedResults, history: History) -> None:
    measured, models = found.measured, found.models
    image: dict[str, Sequence[object] | FloatArray] = {
        "image": range(len(measured["time"])),
        "time_s": measured["time"],
        "stage_um": measured["stage"],
        "cycle": measured["cycle"],
    }
    loads = {**image, "load_measured_uN": measured["force"]}
    for model in models:
        loads[f"load_{model.label}_uN"] = model.load
        loads[f"residual_{model.label}_uN"] = model.load_residual
    write_csv(folder / LOADS_CSV, loads)
    _write_images(folder / IMAGES_CSV, image, measured, models[0])
    _write_knots(folder / KNOTS_CSV, models, history)
    _write_parameters(folder / PARAMETERS_CSV, models, found.start, history.n_knots)


def _write_images(
    path: Path,
    image: Mapping[str, Sequence[object] | FloatArray],
    measured: Mapping[str, FloatArray],
    model: FittedModel,
) -> None:
    _, removed = aligned(measured["motion"], model.motion, measured["xy"], rigid=True)
    shift = 1e3 * removed[:, :3]
    turn = 1e6 * removed[:, 3:]
    columns = {
        **image,
        "elongation_nm": 1e3 * measured["elongation"],
        "tilt_nm": 1e3 * measured["tilt"],
        "chi": measured["chi"],
        **{f"shift_{axis}_nm": shift[:, i] for i, axis in enumerate("XYZ")},
        **{f"slope_{name}_urad": turn[:, i] for i, name in enumerate(("vX", "wX", "wY"))},
    }
    write_csv(path, columns)


def _write_knots(path: Path, models: Sequence[FittedModel], history: History) -> None:
    n = history.n_knots
    columns: dict[str, Sequence[object] | FloatArray] = {
        "knot": range(n),
        "time_s": history.time[history.turning],
        "stage_um": history.stage[history.turning],
    }
    for model in models:
        for what, names in (("elongation", elongation_names(n)), ("tilt", tilt_names(n))):
            values = [0.0, *(1e3 * model.values[name] for name in names)]
            sigma = [1e3 * model.sigma[name] if name in model.sigma else "" for name in names]
            columns[f"{what}_{model.label}_nm"] = values
            columns[f"{what}_{model.label}_sigma_nm"] = ["", *sigma]
    write_csv(path, columns)


def _write_parameters(
    path: Path, models: Sequence[FittedModel], start: Mapping[str, float], n_knots: int
) -> None:
    units = {name: unit for model in models for name, unit in model.units.items()}
    knots = (*elongation_names(n_knots), *tilt_names(n_knots))
    names = [name for name in units if name not in knots]
    columns: dict[str, Sequence[object]] = {
        "parameter": names,
        "unit": [units[name] for name in names],
        "start": [start.get(name, "") for name in names],
    }
    for model in models:
        free = model.sigma
        columns[model.label] = [model.values[n] if n in free else "" for n in names]
        columns[f"{model.label}_sigma"] = [free.get(n, "") for n in names]
    write_csv(path, columns)


def _make_folder(folder: Path, case: Case) -> None:
    if folder.parent == results_of(case):  # nobody has named it
        refuse_unless_agreed(case.file, link_requests(folder.parent))
        refuse_link(folder)
    if folder.exists() and not folder.is_dir():
        raise ExportError(sentence(folder, "--to", "a file", "a folder, or nothing"))
    folder.mkdir(parents=True, exist_ok=True)


def _names(written: Path) -> list[Path]:
    return [path.relative_to(written) for path in written.rglob("*") if path.is_file()]


def _refuse_foreign(folder: Path, names: Sequence[Path]) -> None:
    """Raise where a file that is no file of an earlier export stands in the way of one."""
    known = exported_files(folder / README)
    for name in names:
        place, parent = folder / name, folder / name.parent
        if name in known and not place.is_dir():
            continue
        taken = name if os.path.lexists(place) else name.parent
        if taken == name or (os.path.lexists(parent) and not parent.is_dir()):
            raise ExportError(
                sentence(
                    folder,
                    "--to",
                    f"a file {taken} that is no export of prismid (its {README} lists those)",
                    "a folder without files of that name",
                )
            )


def _move(written: Path, folder: Path) -> None:
    """Replace files one by one: first the one that shows whose they are, last the series."""
    names = sorted(
        _names(written),
        key=lambda name: (name.name == SURFACE_SERIES, name.name != README, str(name)),
    )
    # What an earlier export holds beyond this one is no result of the case as it is.
    for name in exported_files(folder / README) - set(names):
        place_below(folder, name).unlink(missing_ok=True)
    for name in names:
        place = place_below(folder, name)
        place.parent.mkdir(exist_ok=True)
        os.replace(written / name, place)

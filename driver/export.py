"""Results for other programs: the measured face and the volume for ParaView, tables as CSV."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from driver.boundary import elongation_names, tilt_names
from driver.case import Case, load_case
from driver.diagnose_stage import DIAGNOSIS, DIAGNOSIS_H5
from driver.errors import InputError, sentence
from driver.export_readme import README, is_readme, write_readme
from driver.history import History, read_history
from driver.identify_stage import IDENTIFY
from driver.measure_stage import MEASURE
from driver.mesh_stage import MESH
from driver.paraview import SERIES, FittedModel, aligned, write_surface
from driver.pipeline import stages
from driver.results import read_hdf5, write_csv
from driver.stages import RESULTS, stage_key
from driver.volume_view import offers_volume, volume_files, write_volumes
from meshes.files import read_med

FloatArray = NDArray[np.float64]

_NEEDED, _OPTIONAL = ("mesh", "measure", "identify"), "diagnose"
_MESH_VTU = "mesh.vtu"
_LABELS = ("model", "extended")


class ExportError(InputError):
    """Results that cannot be exported: what was found and what was expected."""


def export_case(
    case_path: Path,
    folder: Path,
    volume: bool = True,
    med: bool = False,
    log: Callable[[str], None] = print,
) -> None:
    """Write the finished results of a case in the formats of other programs.

    The folder is made if need be. Files of an earlier export are replaced, each of them whole,
    and other files are left alone. Without a finished diagnosis of the case as it is, what
    belongs to the extended model is left out. The fields of the volume are no results of a run:
    each model is simulated once more for them.

    Args:
        case_path: the case file; its results are in `results/` beside it.
        folder: where to write.
        volume: whether to write the fields of the volume, where the solver answers them.
        med: whether to write them as MED, too.
        log: takes one line of progress.

    Raises:
        CaseError: the case cannot be used.
        ExportError: a stage has no results for the case as it is, or the folder cannot take them.
        ResultError: a result file cannot be read.
        SolverError: a simulation for the volume could not be finished.
    """
    case = load_case(case_path)
    results = case_path.parent / RESULTS
    diagnosed = _finished(case_path, case, results)
    measured = read_hdf5(results / MEASURE)
    models = [_identified(results)]
    if diagnosed:
        models.append(_extended(results, models[0]))
    history = read_history(case.path(case.history.file))
    _make_folder(folder)
    with tempfile.TemporaryDirectory(prefix="partial-", dir=folder) as aside:
        written = Path(aside)
        write_surface(written, measured, models, case.boundary.gauge == "rigid")
        shutil.copyfile((results / MESH).with_suffix(".vtu"), written / _MESH_VTU)
        _write_tables(written, measured, models, history, results)
        if volume and not offers_volume(case):
            log(f"no fields of the volume: the solver {case.solver.name} answers none")
            volume = False
        write_readme(written / README, case_path, diagnosed, volume, volume and med)
        names = _names(written)
        if volume:
            names += [Path(name) for model in models for name in volume_files(model.label, med)]
        _refuse_foreign(folder, names)
        if volume:
            mesh = read_med(results / MESH)
            write_volumes(written, case, mesh, history, models, med, log)
        # A volume of an earlier export that this one lacks is no result of the case as it is.
        every = [Path(name) for label in _LABELS for name in volume_files(label, med=True)]
        _move(written, folder, every)


def _finished(case_path: Path, case: Case, results: Path) -> bool:
    """Whether the diagnosis is finished, too."""
    path = results / "stages.json"
    record = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    key = ""
    for stage in stages(case):
        key = stage_key(stage, case, key)
        done = record.get(stage.name, {"key": None, "outputs": []})
        there = all((results / name).is_file() for name in done["outputs"])
        if done["key"] == key and there:
            if stage.name == _OPTIONAL:
                return True
        elif stage.name in _NEEDED:
            found = "results of another state of the case or its files"
            raise ExportError(
                sentence(
                    results,
                    f"stage {stage.name}",
                    found if done["key"] is not None and there else "no results",
                    f"those of the case as it is (`prismid run {case_path} --until "
                    f"{_NEEDED[-1]}` makes them)",
                )
            )
    return False


def _identified(results: Path) -> FittedModel:
    path = results / IDENTIFY
    arrays = read_hdf5(path)
    with h5py.File(path, "r") as file:
        names, units, values = (
            json.loads(file.attrs[name]) for name in ("names", "units", "all_values")
        )
    return FittedModel(
        label=_LABELS[0],
        **_predictions(arrays, "final"),
        values=values,
        sigma=dict(zip(names, arrays["sigma"].tolist(), strict=True)),
        units=dict(zip(names, units, strict=True)),
    )


def _extended(results: Path, model: FittedModel) -> FittedModel:
    record = json.loads((results / DIAGNOSIS).read_text(encoding="utf-8"))["extended"]
    fitted = {name: entry for name, entry in record.items() if name != "reason"}
    return FittedModel(
        label=_LABELS[1],
        **_predictions(read_hdf5(results / DIAGNOSIS_H5), "after"),
        values={**model.values, **{name: entry["value"] for name, entry in fitted.items()}},
        sigma={name: entry["sigma"] for name, entry in fitted.items()},
        units={name: entry["unit"] for name, entry in fitted.items()},
    )


def _predictions(arrays: Mapping[str, FloatArray], prefix: str) -> dict[str, Any]:
    return {name: arrays[f"{prefix}/{name}"] for name in ("load", "load_residual", "motion", "rho")}


def _write_tables(
    folder: Path,
    measured: Mapping[str, FloatArray],
    models: Sequence[FittedModel],
    history: History,
    results: Path,
) -> None:
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
    write_csv(folder / "loads.csv", loads)
    _write_images(folder / "images.csv", image, measured, models[0])
    _write_knots(folder / "knots.csv", models, history)
    start = read_hdf5(results / IDENTIFY)["start"]
    _write_parameters(folder / "parameters.csv", models, start, history.n_knots)


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
    path: Path, models: Sequence[FittedModel], start: FloatArray, n_knots: int
) -> None:
    starts = dict(zip(models[0].sigma, start.tolist(), strict=True))
    units = {name: unit for model in models for name, unit in model.units.items()}
    knots = (*elongation_names(n_knots), *tilt_names(n_knots))
    names = [name for name in units if name not in knots]
    columns: dict[str, Sequence[object]] = {
        "parameter": names,
        "unit": [units[name] for name in names],
        "start": [starts.get(name, "") for name in names],
    }
    for model in models:
        free = model.sigma
        columns[model.label] = [model.values[n] if n in free else "" for n in names]
        columns[f"{model.label}_sigma"] = [free.get(n, "") for n in names]
    write_csv(path, columns)


def _make_folder(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise ExportError(sentence(folder, "--to", "a file", "a folder, or nothing"))
    folder.mkdir(parents=True, exist_ok=True)


def _names(written: Path) -> list[Path]:
    return [path.relative_to(written) for path in written.rglob("*") if path.is_file()]


def _refuse_foreign(folder: Path, names: Sequence[Path]) -> None:
    """Raise where a file of the export stands in a folder that holds none of prismid's."""
    readme = folder / README
    if readme.is_file() and is_readme(readme):
        return
    for name in names:
        if (folder / name).exists():
            raise ExportError(
                sentence(
                    folder, "--to", f"a file {name} that is no export of prismid",
                    "a folder without files of that name",
                )
            )  # fmt: skip


def _move(written: Path, folder: Path, stale: Sequence[Path]) -> None:
    """Replace files one by one: first the one that shows whose they are, last the series."""
    names = sorted(
        _names(written), key=lambda name: (name.name == SERIES, name.name != README, str(name))
    )
    if (folder / README).exists():
        for name in stale:
            if name not in names:
                (folder / name).unlink(missing_ok=True)
    for name in names:
        (folder / name).parent.mkdir(exist_ok=True)
        os.replace(written / name, folder / name)

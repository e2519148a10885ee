"""What the earlier stages found, read back for the report."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from driver.case.model import Case
from driver.dic.residual_noise import residual_variance
from driver.experiment.history import History, knot_weights, read_history
from driver.forward.boundary_motion import BoundaryMotion
from driver.forward.build import parameters_of
from driver.forward.geometry import boundary_traces
from driver.identification.measured_slip import MeasuredSlip
from driver.identification.slip_activity import SlipActivity
from driver.identification.travel_ratio import TravelRatio
from driver.report.identified import IdentifiedParameter, estimates
from driver.report.measured import DATASETS, MeasuredMotion, measured_motion, peaks
from driver.report.measured_figures import FIGURES
from driver.results.advice import read_advised_text
from driver.results.diagnosis import OMNIBUS
from driver.results.files import (
    ADVICE,
    DIAGNOSIS,
    DIAGNOSIS_H5,
    EXTENDED,
    FINE_MESH,
    HISTORY_JSON,
    IDENTIFY,
    IDENTIFY_CSV,
    MEASURE,
    MEASURE_CSV,
    MESH,
    REPORT_CSV,
    present,
)
from driver.results.hdf5 import damaged, read_hdf5
from driver.results.identification import (
    read_identification,
    written_measured_slip,
    written_slip,
)
from driver.results.json_files import read_json
from driver.results.stage_record import read_record
from meshes.arrays import FloatArray
from meshes.files import read_med
from meshes.prism_mesh import PrismMesh
from solver_adapters.parameter import Parameter

Record = dict[str, Any]

FILES = {
    MESH: "working mesh, for Salome and Code_Aster",
    FINE_MESH: "finer mesh behind the correction",
    MEASURE: "motion by free correlation, with covariance",
    MEASURE_CSV: "elongation, tilt and load of each image",
    IDENTIFY: "parameters, covariance, predictions",
    IDENTIFY_CSV: "parameters of the model of the case, no cause added",
    HISTORY_JSON: "iterations of each stage",
    DIAGNOSIS: "verdict, evidence of every cause, gain",
    ADVICE: "changes of the experiment that would part a set of causes",
    DIAGNOSIS_H5: "loads, motion and image residuals before and after",
    EXTENDED: "the case with the causes that were added",
    REPORT_CSV: "parameters of the final model, and of the one that it replaces",
}

_READ = (MESH, MEASURE, IDENTIFY, HISTORY_JSON)
_DIAGNOSED = (DIAGNOSIS, DIAGNOSIS_H5, ADVICE)
_MEASURED = (
    "time", "force", "xy", "left_out", "sigma_flat", "noise_later", *DATASETS)  # fmt: skip
_IDENTIFIED = (
    "start", "values", "covariance", "correlation", "kinematic_hessian", "hessian_names",
    "prior/mean", "prior/width", "prior_share", "paper/chi", "paper/chi_f", "paper/chi_F",
    "initial/load", "noise_factor", "budget/free", "budget/model", "budget/basis", "budget/load",
)  # fmt: skip
_BUDGET = ("free", "model", "basis", "load")
_PREDICTED = ("load", "motion", "rho")
_FITTED = ("before/load", "before/motion", "before/rho", "after/load", "after/motion", "after/rho")


@dataclass(frozen=True, eq=False)
class Findings:
    """Results of a case, T images, n_pix pixels, k identified parameters.

    Attributes:
        case: the case.
        mesh: the working mesh.
        history: the loading history.
        measured: datasets of `measure.h5`.
        motion: the same as the pictures of free correlation need it.
        pictures: these pictures as PNG files, by name without ending.
        predicted: datasets of `diagnosis.h5`: "before/…", "after/…"; without a diagnosis those of
            the identification as "before/…".
        estimates: the k identified parameters of the baseline, by name.
        identified: datasets of `identify.h5`, without predictions.
        hessian_names: parameters of the kinematic Hessian.
        warnings: sentences on what the data did not decide.
        seconds: what each part of the run took, by name [s].
        values: every parameter of the general model at the baseline.
        noise_factor: noise on the correlation basis over that of the repeats.
        iterations: iterations of each stage of the identification.
        diagnosis: content of `diagnosis.json`, empty before a diagnosis.
        advice: which change of the experiment would part a set of causes, in words, or empty.
    """

    case: Case
    mesh: PrismMesh
    history: History
    measured: dict[str, FloatArray]
    motion: MeasuredMotion
    pictures: dict[str, bytes]
    predicted: dict[str, FloatArray]
    estimates: dict[str, IdentifiedParameter]
    identified: dict[str, FloatArray]
    hessian_names: tuple[str, ...]
    warnings: tuple[str, ...]
    seconds: dict[str, float]
    values: dict[str, float]
    noise_factor: float
    iterations: Record
    diagnosis: Record
    advice: str

    @property
    def diagnosed(self) -> bool:
        """Whether there is a diagnosis."""
        return bool(self.diagnosis)

    @property
    def extended(self) -> bool:
        """Whether causes were added to the model."""
        return bool(self.diagnosis.get("added") or self.diagnosis.get("flips"))

    @property
    def budgets(self) -> dict[str, dict[str, float]]:
        """The error budget of each model that is shown: "free", "model", "basis", "load"."""
        if self.diagnosed:
            return {side: self.diagnosis["gain"][f"budget_{side}"] for side in self.sides}
        return {"before": {part: float(self.identified[f"budget/{part}"]) for part in _BUDGET}}

    @property
    def sides(self) -> tuple[str, ...]:
        """The models to be shown: before and, where causes were added, after."""
        return ("before", "after") if self.extended else ("before",)

    @property
    def declared(self) -> dict[str, Parameter]:
        """Every parameter of the general model by name, scaled at the constants of the case."""
        return _declared(self.case, self.history)

    @property
    def travel_ratio(self) -> TravelRatio | None:
        """Elongation over stage travel by the final model, None where knots were held."""
        if self.diagnosed:
            told = self.diagnosis["travel_ratio"]
            return None if told is None else TravelRatio(**told)
        if "travel_ratio" not in self.identified:
            return None
        return TravelRatio(*self.identified["travel_ratio"].tolist())

    @property
    def slip(self) -> SlipActivity | None:
        """Slips of the final model, None of a solver that tells none."""
        return written_slip(self.predicted if self.diagnosed else self.identified)

    @property
    def measured_slip(self) -> MeasuredSlip | None:
        """Slips that the images tell without a law, None where they were not sought."""
        return written_measured_slip(self.identified)

    @property
    def load_noise(self) -> float:
        """γ_F [µN]."""
        return self.case.loads.gamma_F

    def start_of(self, name: str) -> float:
        """Value of a parameter where the identification began."""
        estimate = self.estimates.get(name)
        return self.values[name] if estimate is None else estimate.start

    def fitted(self, side: str) -> dict[str, Record]:
        """Return the free parameters of a model with "value", "sigma" and "unit", by name."""
        if self.diagnosed:
            model = self.diagnosis["baseline" if side == "before" else "extended"]
            return dict(model["values"])
        return {
            name: {"value": found.value, "sigma": found.sigma, "unit": found.parameter.unit}
            for name, found in self.estimates.items()
        }

    def fitted_values(self, side: str) -> dict[str, float]:
        """Every parameter of the general model before or after."""
        return self.values | {n: v["value"] for n, v in self.fitted(side).items()}

    def residual(self, side: str) -> FloatArray:
        """ρ in units of the standard deviation that noise alone gives it, shape (T, n_pix).

        That depends on where the pixels fell, so the stage's translation counts: it is what free
        correlation saw beyond the model.
        """
        m, motion = self.measured, self.predicted[f"{side}/motion"][..., :2]
        seen = motion + np.mean(m["motion"][..., :2] - motion, axis=1, keepdims=True)
        variance = residual_variance(
            m["xy"] / m["pixel"] + m["origin"], seen / m["pixel"], float(m["sigma"]),
            float(m["n_reference"]), float(m["sigma_flat"]),
        )  # fmt: skip
        return np.asarray(self.predicted[f"{side}/rho"] / np.sqrt(variance))

    def edges(self, side: str) -> FloatArray:
        """Return the identified elongation and tilt in each row [µm], shape (n_rows, 2)."""
        weights = knot_weights(self.history)
        boundary = BoundaryMotion(
            nodes=np.array([0, 1]),
            side=np.array([1.0, -1.0]),
            zeta=np.zeros(2),
            across=np.zeros(2),
            weights=weights,
            mask=np.ones((2, 3), dtype=bool),
        )
        motion = boundary.evaluate(self.fitted_values(side))
        return np.asarray(motion[:, 0, 1:] - motion[:, 1, 1:])

    @property
    def peaks(self) -> NDArray[np.int64]:
        """The image at the largest stage travel of each cycle."""
        return peaks(self.measured["stage"], self.measured["cycle"].astype(np.int64))


def read_findings(case: Case, results: Path, diagnosed: bool = True) -> Findings:
    """Read all results that the report shows.

    Args:
        case: the case.
        results: the folder of its results.
        diagnosed: whether the diagnosis is finished; if not, the identification is shown alone.

    Raises:
        AbsentError: a result is absent.
        ResultError: a result is damaged or lacks what the report shows.
        HistoryError: the history cannot be used.
    """
    needed = (*_READ, *_DIAGNOSED) if diagnosed else _READ
    paths = {name: present(results, name) for name in needed}
    of_model = () if diagnosed else tuple(f"final/{what}" for what in _PREDICTED)
    identified = _datasets(paths[IDENTIFY], (*_IDENTIFIED, *of_model))
    identification = read_identification(paths[IDENTIFY])
    measured = _datasets(paths[MEASURE], _MEASURED)
    history = read_history(case.path(case.history.file), stated=case.history)
    # A term of the user's own that was installed since the identification is at its null.
    null = {name: parameter.null for name, parameter in _declared(case, history).items()}
    iterations = _record(paths[HISTORY_JSON], ("C",))
    return Findings(
        case=case,
        mesh=read_med(paths[MESH]),
        history=history,
        measured=measured,
        motion=measured_motion(measured, case.images.level_um, boundary_traces(case)),
        pictures={Path(name).stem: present(results, name).read_bytes() for name in FIGURES},
        predicted=_datasets(paths[DIAGNOSIS_H5], _FITTED)
        if diagnosed
        else {f"before/{what}": identified[f"final/{what}"] for what in _PREDICTED},
        estimates=estimates(identification.names, _declared(case, history), identified),
        identified=identified,
        hessian_names=tuple(name.decode() for name in identified["hessian_names"].tolist()),
        warnings=identification.warnings,
        seconds=_seconds(results, iterations),
        values=null | identification.values,
        noise_factor=float(identified["noise_factor"]),
        iterations=iterations,
        diagnosis=_diagnosis(paths[DIAGNOSIS]) if diagnosed else {},
        advice=read_advised_text(paths[ADVICE]) if diagnosed else "",
    )


def _declared(case: Case, history: History) -> dict[str, Parameter]:
    return parameters_of(case, history.n_knots)


def _seconds(results: Path, iterations: Record) -> dict[str, float]:
    """Duration of the stages of the run [s], the identification by its own stages."""
    spent: dict[str, float] = {}
    for name, done in read_record(results).items():
        if name == "identify":
            parts = {f"identify {part}": r["seconds"] for part, r in iterations.items()}
            spent |= parts | {"identify, the rest": done["seconds"] - sum(parts.values())}
        elif name != "report":
            spent[name] = done["seconds"]
    return spent


def _datasets(path: Path, expected: tuple[str, ...]) -> dict[str, FloatArray]:
    datasets = read_hdf5(path)
    for name in expected:
        if name not in datasets:
            raise damaged(path, f"no dataset {name}")
    return datasets


_OF_NUMERICS = (
    "off_by_mesh",
    "between_meshes",
    "fitted_anew",
    "missing_share",
    "second_mesh_um",
)


def _diagnosis(path: Path) -> Record:
    entries = (
        "verdict", "sets", "added", "flips", "whereabouts", "gain", "steps", "bad_loads",
        "not_examined", "numerics", "warnings", "travel_ratio", "critical_stress",
    )  # fmt: skip
    record = _record(path, entries)
    for entry in _OF_NUMERICS:
        if entry not in record["numerics"]:
            raise damaged(path, f"no entry {entry} in numerics")
    for step in record["steps"]:
        refits = [cause["refit"] for cause in step["causes"] if cause["refit"] is not None]
        if any("corrected" not in refit for refit in refits):
            raise damaged(path, "no entry corrected in steps.causes.refit")
        if "left_something" not in step:
            raise damaged(path, "no entry left_something in steps")
        for name in OMNIBUS:
            if name not in step["omnibus"]:
                raise damaged(path, f"no entry {name} in steps.omnibus")
    return record


def _record(path: Path, expected: tuple[str, ...]) -> Record:
    record = read_json(path)
    for name in expected:
        if name not in record:
            raise damaged(path, f"no entry {name}")
    return record

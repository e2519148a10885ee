"""Results of a small invented case, in the layout in which the stages write them."""

import copy
import csv
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case.model import load_case, write_case
from driver.diagnosis.causes.causes import LIBRARY, NUMERICS
from driver.dic.basis import grid_basis
from driver.forward.build import geometry_of
from driver.parameters.registry import declared_parameters
from driver.report.findings import Findings, read_findings
from driver.report.measured import MeasuredMotion, measured_motion
from driver.report.measured_figures import FIGURES
from driver.results.hdf5 import read_hdf5, write_hdf5
from driver.workflow.engine import StageContext
from meshes.arrays import FloatArray, IntArray
from meshes.files import read_med, write_med
from meshes.prism import generate
from tests.driver.stated_sizes import stated_case

STAGE = (0.0, 10.0, 20.0, 30.0, 20.0, 10.0, 25.0, 40.0, 55.0, 45.0, 35.0)
CYCLE = (1, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2)
PHASE = (0, 0, 0, 0, 1, 1, 2, 2, 2, 3, 3)
PEAKS = (3, 8)
KNOTS = (0.030, 0.018, 0.060, 0.042)  # elongation at the turning points after the first [µm]
PIXEL, ORIGIN = 0.11, (20.0, 6.0)
LAW = ("tau0", "c", "d")
LAMBDAS = ("lambda_plus_Y", "lambda_plus_Z", "lambda_minus_Y", "lambda_minus_Z")
VALUES = {"tau0": 21.34, "c": 44120.0, "d": 1140.0} | dict.fromkeys(LAMBDAS, 0.97)
SIGMAS = {"tau0": 0.12, "c": 350.0, "d": 13.0} | dict.fromkeys(LAMBDAS, 0.021)
NODAL_SIGMA = (0.019, 0.018, 0.002)  # of u, v, w at a node, the reference's noise included [µm]
PRIOR_WIDTH = {"tau0": 1.0, "c": 1.0, "d": 0.0125} | dict.fromkeys(LAMBDAS, 2.0)  # in θ
SEED = 3


@dataclass
class Results:
    """A case folder with results of all stages before the report."""

    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results"

    def context(self, workdir: Path) -> StageContext:
        workdir.mkdir(exist_ok=True)
        path = self.folder / "case.toml"
        return StageContext(load_case(path), self.results, workdir)

    def findings(self) -> Findings:
        return read_findings(load_case(self.folder / "case.toml"), self.results)

    def edit_diagnosis(self, **changes: Any) -> None:
        """Replace entries of `diagnosis.json`."""
        path = self.results / "diagnosis.json"
        path.write_text(json.dumps(json.loads(path.read_text("utf-8")) | changes), "utf-8")


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Results:
    """The results, written once."""
    folder = tmp_path_factory.mktemp("prisms") / "invented"
    (folder / "results").mkdir(parents=True)
    case = stated_case()
    write_case(case, folder / "case.toml")
    write_med(generate(geometry_of(case), 3.0), folder / "results" / "mesh.med")
    time = np.arange(len(STAGE), dtype=float) * 40.0
    with (folder / "history.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("time_s", "stage_um", "image", "force_N"))
        rows.writerows(
            (t, s, k, 10.0 * s) for k, (t, s) in enumerate(zip(time, STAGE, strict=True))
        )
    rng = np.random.default_rng(SEED)
    _write_measured(folder / "results" / "measure.h5", time, rng)
    _write_identified(folder / "results")
    _write_diagnosed(folder / "results", rng)
    return Results(folder)


@pytest.fixture
def results(written: Results, tmp_path: Path) -> Results:
    """A copy of the results that a test may change."""
    copied = Results(tmp_path / "invented")
    copied.results.mkdir(parents=True)
    for path in (*written.folder.glob("*.*"), *written.results.glob("*")):
        if path.is_file():
            (copied.folder / path.relative_to(written.folder)).write_bytes(path.read_bytes())
    return copied


@pytest.fixture(scope="session")
def measured(written: Results) -> MeasuredMotion:
    """The invented motion of free correlation."""
    traces = np.array([[[-2.0, 5.0], [2.0, 6.0]]])
    return measured_motion(read_hdf5(written.results / "measure.h5"), 0.0065, traces)


def pixels() -> tuple[IntArray, IntArray]:
    """Rows and columns of the region of interest."""
    rows, cols = np.meshgrid(np.arange(5, 36), np.arange(8, 112), indexing="ij")
    return rows.ravel(), cols.ravel()


def _write_measured(path: Path, time: FloatArray, rng: np.random.Generator) -> None:
    rows, cols = pixels()
    T, n_pix = len(STAGE), rows.size
    xy = np.column_stack([(rows - ORIGIN[0]) * PIXEL, (cols - ORIGIN[1]) * PIXEL])
    elongation = np.interp(np.arange(T), (0, 3, 5, 8, 10), (0.0, *KNOTS))
    motion = np.zeros((T, n_pix, 3))
    motion[..., 1] = elongation[:, None] * (xy[:, 1] / 12 - 0.5)
    bounds = tuple(np.column_stack([xy.min(axis=0), xy.max(axis=0)]).ravel())
    uv_mesh, w_mesh = (grid_basis(xy, bounds, size * PIXEL) for size in (16, 8))
    v = elongation[:, None] * (uv_mesh.nodes[:, 1] / 12 - 0.5)
    deviations = np.repeat(NODAL_SIGMA, [len(v[0]), len(v[0]), len(w_mesh.nodes)])
    variances = deviations**2 / (1.0 + 1.0 / 10.0)
    noise = rng.standard_normal((T, n_pix))
    noise /= np.sqrt(np.mean(noise**2, axis=1, keepdims=True))
    chi = 1.0 + 0.02 * rng.standard_normal(T)
    write_hdf5(
        path,
        {
            "time": (time, "s"),
            "stage": (np.array(STAGE), "µm"),
            "cycle": (np.array(CYCLE), "1"),
            "force": (23.1 * np.array(STAGE), "µN"),
            "reference": (0.01 * rng.standard_normal((41, 120)), "µm"),
            "pixel": (PIXEL, "µm"),
            "origin": (np.array(ORIGIN), "pixel"),
            "xy": (xy, "µm"),
            "rows": (rows, "pixel"),
            "cols": (cols, "pixel"),
            "sigma": (0.009, "µm"),
            "n_reference": (10.0, "1"),
            "motion": (motion, "µm"),
            "coefficients": (np.hstack([0 * v, v, np.zeros((T, len(w_mesh.nodes)))]), "µm"),
            "covariance_one": (np.diag(variances), "µm²"),
            "nodes_uv": (uv_mesh.nodes, "µm"),
            "nodes_w": (w_mesh.nodes, "µm"),
            "cells_uv": (uv_mesh.mesh.corners, "1"),
            "cells_w": (w_mesh.mesh.corners, "1"),
            "residual": (0.009 * noise * chi[:, None], "µm"),
            "residual_over_noise": (noise * chi[:, None], "1"),
            "chi": (chi, "1"),
            "elongation": (elongation + 0.005 * rng.standard_normal(T), "µm"),
            "elongation_sigma": (0.005, "µm"),
            "elongation_covariance": (0.005**2 * np.eye(T), "µm²"),
            "elongation_held": (0.0, "µm"),
            "elongation_single": (0.005, "µm"),
            "tilt": (0.001 * rng.standard_normal(T), "µm"),
            "tilt_sigma": (0.001, "µm"),
            "tilt_covariance": (0.001**2 * np.eye(T), "µm²"),
            "tilt_held": (0.0, "µm"),
            "tilt_single": (0.001, "µm"),
            "mean_w": (0.03 * rng.standard_normal(T), "µm"),
            "mean_w_sigma": (0.0002, "µm"),
            "mean_w_covariance": (0.0002**2 * np.eye(T), "µm²"),
            "mean_w_held": (0.0, "µm"),
            "mean_w_single": (0.0002, "µm"),
            "converged": (np.ones(T), "1"),
            "stopped": (np.array([b"update of u, v below 0.0001 px"] * T), "text"),
            "penalty": (np.array(b"tikhonov"), "text"),
            "roughness": (0.05 * PIXEL, "µm"),
            "roughness_estimated": (1.0, "1"),
            "travel_length": (0.0, "µm"),
            "smoother": (np.eye(T), "1"),
            "gain": (np.ones(T), "1"),
            "left_out": (1.0 * (np.arange(T) == 7), "1"),
            "sigma_flat": (0.0, "µm"),
            "noise_later": (0.009, "µm"),
            "phase": (np.array(PHASE), "1"),
            "grip/nominal": (12.0 / 32e3, "1"),
            "grip/sigma": (0.0005, "µm"),
            "grip/unpenalised_sigma": (np.inf, "µm"),
            "elongation_unpenalised": (np.zeros(T), "µm"),
        },
    )
    for name in FIGURES:
        # What the report embeds as it finds it.
        (path.parent / name).write_bytes(b"\x89PNG " + Path(name).stem.encode())


def _knot_names() -> list[str]:
    n = len(KNOTS)
    return [f"elongation_{k + 1}" for k in range(n)] + [f"tilt_{k + 1}" for k in range(n)]


def _fitted(extra: Iterable[tuple[str, Any]] = ()) -> dict[str, Any]:
    declared = declared_parameters(len(KNOTS) + 1)
    values = VALUES | dict(zip(_knot_names(), (*KNOTS, *np.zeros(len(KNOTS))), strict=True))
    sigmas = SIGMAS | dict.fromkeys(_knot_names(), 2e-4)
    record = {
        name: {"value": values[name], "sigma": sigmas[name], "unit": declared[name].unit}
        for name in (*LAMBDAS, *_knot_names(), *LAW)
    }
    end = {"converged": True, "reason": "the Newton decrement is 0.04 σ"}
    return {"values": record | dict(extra), **end}


def _write_identified(folder: Path) -> None:
    names = [*LAMBDAS, *_knot_names(), *LAW]
    declared = declared_parameters(len(KNOTS) + 1)
    fitted = _fitted()["values"]
    correlation = np.eye(len(names))
    correlation[-1, -2] = correlation[-2, -1] = -0.93
    sigmas = [fitted[n]["sigma"] / declared[n].slope(fitted[n]["value"]) for n in names]
    covariance = correlation * np.outer(sigmas, sigmas)
    null = {name: parameter.null for name, parameter in declared.items()}
    start = np.array([null[name] for name in names])
    width = np.array([PRIOR_WIDTH.get(name, np.inf) for name in names])
    values = np.array([fitted[name]["value"] for name in names])
    everything = null | {name: fitted[name]["value"] for name in names}
    load = 23.1 * np.array(STAGE)
    write_hdf5(
        folder / "identify.h5",
        {
            "start": (start, "see units"),
            "values": (values, "see units"),
            "covariance": (covariance, "of θ"),
            "correlation": (correlation, "1"),
            "prior/mean": (np.where(np.isinf(width), np.nan, start), "see units"),
            "prior/width": (width, "of θ"),
            "prior_share": (
                np.where(np.array(names) == "d", 0.83, np.diag(covariance) / width**2),
                "1",
            ),
            "kinematic_hessian": (np.diag(np.arange(7.0, 0.0, -1.0)), "of log p"),
            "hessian_names": (np.array([*LAMBDAS, *LAW], dtype="S"), ""),
            "paper/chi": (np.array([4.64, 4.52]), "1"),
            "paper/chi_f": (np.array([4.46, 4.47]), "1"),
            "paper/chi_F": (np.array([78.0, 58.0]), "1"),
            "initial/load": (30.0 * np.array(STAGE), "µN"),
            "noise_factor": (1.04, "1"),
            "budget/free": (1.01, "1"),
            "budget/model": (1.33, "1"),
            "budget/basis": (1.62, "1"),
            "budget/load": (6.9, "1"),
            "final/load": (load, "µN"),
            "final/motion": (np.zeros((len(STAGE), pixels()[0].size, 3), np.float32), "µm"),
            "final/rho": (np.zeros((len(STAGE), pixels()[0].size), np.float32), "µm"),
            **_slips(folder),
            **_measured_slips(),
        },
        {
            "names": json.dumps(names),
            "units": json.dumps([""] * len(names)),
            "converged": "yes",
            "warnings": json.dumps(["d: the data hardly see it", "λ⁺_Y stands at 5"]),
            "all_values": json.dumps(everything),
            "reason": "the Newton decrement is 0.04 σ",
        },
    )
    iteration = {name: fitted[name]["value"] for name in names}
    stages = {
        stage: {
            "reason": "the Newton decrement is 0.04 σ",
            "seconds": 20.0,
            "iterations": [
                iteration
                | {"tau0": 40.0 - 5 * k, "cost": 10.0, "chi_image": 2.0 - 0.3 * k}
                | {"chi_load": 0.0 if stage == "A" else 30.0 / (k + 1)}
                | (dict.fromkeys(LAMBDAS, 1.0) if stage == "A" and k == 0 else {})
                | {"paper_chi": 5.0 - k, "paper_chi_f": 4.6 - 0.1 * k, "paper_chi_F": 78.0 - k}
                for k in range(3)
            ],
        }
        for stage in ("A", "B", "C")
    }
    (folder / "identify_history.json").write_text(json.dumps(stages), "utf-8")
    done = {
        name: {"key": "", "outputs": [], "finished": "", "seconds": seconds}
        for name, seconds in (("mesh", 0.5), ("measure", 9.5), ("identify", 90.0))
    }
    (folder / "stages.json").write_text(json.dumps(done), "utf-8")


def _slips(folder: Path) -> dict[str, tuple[FloatArray, str]]:
    """Slips that grow to 1, 2, … 24 per mille, those of grain 2 the other way round."""
    T, n_cells = len(STAGE), len(read_med(folder / "mesh.med").cells)
    end = 1e-3 * np.arange(1.0, 25.0)
    grown = np.linspace(0.0, 1.0, T)[:, None, None] * np.stack([end, end[::-1]])
    return {
        "slip/images": (np.arange(T, dtype=np.float64), "1"),
        "slip/grains": (grown, "1"),
        "slip/cells": (np.linspace(0.1, 0.5, n_cells), "1"),
    }


def _measured_slips() -> dict[str, tuple[FloatArray | float, str]]:
    """Slip of grain 1 on systems 2 and 23, 5 ± 1 and 12 ± 2 per mille; of grain 2 is none known."""
    slip, sigma, without = (np.full((2, 24), np.nan) for _ in range(3))
    slip[0], sigma[0] = 0.0, 0.0
    slip[0, [2, 23]], sigma[0, [2, 23]] = [-0.005, 0.012], [0.001, 0.002]
    without[0, [2, 23]] = [0.08, np.inf]
    nothing = [np.nan] * 3
    return {
        "measured_slip/image": (float(len(STAGE) - 1), "1"),
        "measured_slip/strain": (np.array([[-0.004, 0.008, 0.001], nothing]), "1"),
        "measured_slip/strain_sigma": (np.array([[0.001, 0.0005, 0.002], nothing]), "1"),
        "measured_slip/elastic": (np.array([[-0.0001, 0.0003, 0.0], nothing]), "1"),
        "measured_slip/slip": (slip, "1"),
        "measured_slip/sigma": (sigma, "1"),
        "measured_slip/without": (without, "1"),
        "measured_slip/total": (np.array([[0.017, 0.003, 0.006], nothing]), "1"),
    }


def _write_diagnosed(folder: Path, rng: np.random.Generator) -> None:
    rows, _ = pixels()
    T = len(STAGE)
    load = 23.1 * np.array(STAGE)
    arrays = {}
    for side, off, noise in (("before", 40.0, 0.012), ("after", 4.0, 0.009)):
        arrays[f"{side}/load"] = (load + off * rng.standard_normal(T), "µN")
        arrays[f"{side}/motion"] = (np.zeros((T, rows.size, 3), np.float32), "µm")
        rho = noise * rng.standard_normal((T, rows.size))
        arrays[f"{side}/rho"] = (rho.astype(np.float32), "µm")
    write_hdf5(folder / "diagnosis.h5", arrays | _slips(folder))
    advice = {"causes": [], "changes": [], "text": ""}
    (folder / "advice.json").write_text(json.dumps(advice), "utf-8")
    (folder / "diagnosis.json").write_text(json.dumps(diagnosis()), "utf-8")


def diagnosis() -> dict[str, Any]:
    """A verdict that names one cause, found in two rounds."""
    added = {"tau0_grain2": {"value": 1.1493, "sigma": 0.0041, "unit": ""}}
    goodness_of_fit = {"load_slow_p": 0.4, "load_serial_p": 0.2, "image_slow_p": 0.6,
               "image_outlier_p": 0.9, "together_p": 0.5, "smooth_p": 0.4,
               "accepted": True}  # fmt: skip
    found = goodness_of_fit | {"load_slow_p": 3e-7, "accepted": False}
    return {
        "verdict": "named",
        "causes": ["grain_contrast"],
        "sets": [["grain_contrast"]],
        "text": "The two grains have different critical resolved shear stresses.",
        "next": "Confirm grain contrast: nano-indentation of both grains.",
        "added": added,
        "whereabouts": {
            "text": "The identified model misses what the images show most at grain 2.",
            "before": [_excess("grain 2", "unloading", 12.3, 1e-9),
                       _excess("the loads", "unloading", 0.4, 1.0)],
            "after": [_excess("grain 2", "unloading", 5.1, 1e-4),
                      _excess("the loads", "unloading", 0.0, 1.0)],
        },
        "gain": {
            "share_of_excess_explained": 0.987,
            "log_bayes_factor": 312.4,
            "budget_before": {"noise": 1, "free": 1.01, "model": 1.31, "basis": 1.6, "load": 6.7},
            "budget_after": {"noise": 1, "free": 1.01, "model": 1.02, "basis": 1.03, "load": 0.98},
            "shift_in_sigma": {"tau0": 0.0, "c": 0.0, "d": 0.0},
            "held_out": {
                "cycle": 2,
                "chi_load_before": 5.31,
                "chi_load_after": 1.07,
                "chi_image_before": 1.52,
                "chi_image_after": 1.04,
            },
        },
        "flips": [],
        "bad_loads": [{"image": 4, "off_uN": 61.0, "sigmas": 9.8}],
        "not_examined": {
            "fixed_pattern": "no flats show the pattern",
            "ebsd_flip_x": "nothing calls for it",
            "ebsd_flip_y": "nothing calls for it",
        },
        "numerics": {"effect_sigma": 0.31, "on": "grain_contrast", "passed": True,
                     "between_meshes": False, "fitted_anew": 0, "missing_share": None,
                     "second_mesh_um": None, "off_by_mesh": {"tau0_grain2": 0.0072}},
        "warnings": ["far off the prior, in widths of it: d by +3.4"],
        "travel_ratio": {"value": 5.1e-4, "sigma": 0.05e-4, "of_phases": 0.9e-4},
        "critical_stress": [_band()],
        "baseline": _fitted(),
        "extended": _fitted(copy.deepcopy(added).items()),
        "steps": [
            {
                "chi_load": 6.7, "chi_image": 1.6, "omnibus": found,
                "named": ["grain_contrast", "family_112"], "left_something": [],
                "causes": _causes(("grain_contrast", "family_112"), ()),
            },
            {
                "chi_load": 0.98, "chi_image": 1.03, "omnibus": goodness_of_fit, "named": [],
                "left_something": [],
                "causes": _causes((), ("grain_contrast",)),
            },
        ],
    }  # fmt: skip


def _band() -> dict[str, Any]:
    return {
        "grain": 2, "text": "The band in grain 2 has 0.70 ± 0.04 times the critical stress.",
        "y_um": [6.0, 8.0, 10.0], "ratio": [1.0, 0.7, 1.0], "sigma": [0.0, 0.04, 0.0],
        "band": {"ratio": [0.7, 0.04], "middle_um": [8.0, 0.1], "width_um": [1.5, 0.3]},
    }  # fmt: skip


def _excess(place: str, phase: str, misfit: float, p: float) -> dict[str, Any]:
    return {"place": place, "phase": phase, "misfit_sigma": misfit, "p_family": p}


def _causes(refitted: Sequence[str], without: Sequence[str]) -> list[dict[str, Any]]:
    declared = declared_parameters(len(KNOTS) + 1)
    records: list[dict[str, Any]] = []
    for rank, cause in enumerate((*LIBRARY, NUMERICS)):
        if cause.name in without:
            continue
        names = cause.parameters
        records.append(
            {
                "cause": cause.name,
                "category": cause.category,
                "sentence": cause.sentence,
                "parameters": list(names),
                "units": [declared[n].unit if n in declared else "" for n in names],
                "statistic": 4.0,
                "degrees": len(names),
                "p_family": 10.0 ** (-12 + rank) if rank < 12 else 1.0,
                "log_evidence": 40.0 - 4.0 * rank,
                "estimate": [0.14 for _ in names],
                "smallest_visible": [None if cause.name == "load_drift" else 0.02 for _ in names],
                "refit": {
                    "log_evidence": 300.0 - 200.0 * refitted.index(cause.name),
                    "corrected": "at its end",
                    "chi_load": 1.0,
                    "chi_image": 1.0,
                    "values": dict.fromkeys(names, 1.1493),
                    "sigma": dict.fromkeys(names, 0.0041),
                }
                if cause.name in refitted
                else None,
            }
        )
    records.sort(key=lambda record: -record["log_evidence"])
    return records

from __future__ import annotations

import csv
import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.results.hdf5 import ResultError
from driver.results.identification import (
    read_identification,
    written_correction,
    written_jitter,
    written_noise_factor,
    written_trajectory,
)
from meshes.files import read_med
from meshes.surface_grains import grains_at
from tests.driver.results.datasets import datasets, documented_datasets

TEXTS = {
    "names": json.dumps(["tau0", "c"]), "units": json.dumps(["MPa", "MPa"]),
    "all_values": json.dumps({"tau0": 21, "c": 44e3, "n": 10.0}),
    "warnings": json.dumps(["c stands at its bound"]), "reason": "it ended", "converged": "yes",
}  # fmt: skip


def written(path: Path, **changes: str | None) -> Path:
    with h5py.File(path, "w") as file:
        for name, text in (TEXTS | changes).items():
            if text is not None:
                file.attrs[name] = text
    return path


def test_the_words_of_an_identification_are_read_back(tmp_path: Path) -> None:
    told = read_identification(written(tmp_path / "identify.h5"))
    assert told.names == ("tau0", "c") and told.units == ("MPa", "MPa")
    assert told.values == {"tau0": 21.0, "c": 44e3, "n": 10.0}
    assert told.warnings == ("c stands at its bound",)
    assert told.reason == "it ended" and told.converged
    assert not read_identification(written(tmp_path / "open.h5", converged="")).converged


@pytest.mark.parametrize("name", TEXTS)
def test_an_attribute_that_is_absent_is_named(name: str, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match=f"found no attribute {name}"):
        read_identification(written(tmp_path / "identify.h5", **{name: None}))


def test_parameters_that_are_no_json_are_a_damaged_result(tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="found no readable parameters"):
        read_identification(written(tmp_path / "identify.h5", all_values="[1, 2"))


K, T, P, LAW = 17, 44, 560, ("tau0", "c", "d")
LAMBDAS = ("lambda_plus_Y", "lambda_plus_Z", "lambda_minus_Y", "lambda_minus_Z")
NAMES = [
    *LAMBDAS, "origin_X", "origin_Y", *(f"elongation_{k}" for k in (1, 2, 3, 4)),
    *(f"tilt_{k}" for k in (1, 2, 3, 4)), *LAW,
]  # fmt: skip
UNITS = ["", "", "", "", *10 * ["µm"], "MPa", "MPa", ""]
DATASETS = {
    "values": ((K,), "see units"), "sigma": ((K,), "see units"), "start": ((K,), "see units"),
    "covariance": ((K, K), "of θ"), "correlation": ((K, K), "1"),
    "prior/mean": ((K,), "see units"), "prior/width": ((K,), "of θ"), "prior_share": ((K,), "1"),
    "travel_ratio": ((3,), "1"),
    "initial/load": ((T,), "µN"), "correction/load": ((T,), "µN"),
    "correction/motion": ((T, P, 3), "µm"), "correction/parts": ((), "1"),
    "noise_factor": ((), "1"), "kinematic_hessian": ((7, 7), "of log p"),
    "hessian_names": ((7,), ""), "paper/chi": ((2,), "1"), "paper/chi_f": ((2,), "1"),
    "paper/chi_F": ((2,), "1"), "budget/noise": ((), "1"), "budget/free": ((), "1"),
    "budget/model": ((), "1"), "budget/basis": ((), "1"), "budget/load": ((), "1"),
    "final/load": ((T,), "µN"), "final/load_residual": ((T,), "µN"),
    "final/motion": ((T, P, 3), "µm"), "final/rho": ((T, P), "µm"),
    "measured_slip/image": ((), "1"), "measured_slip/strain": ((2, 3), "1"),
    "measured_slip/strain_sigma": ((2, 3), "1"), "measured_slip/elastic": ((2, 3), "1"),
    "measured_slip/slip": ((2, 24), "1"), "measured_slip/sigma": ((2, 24), "1"),
    "measured_slip/without": ((2, 24), "1"), "measured_slip/total": ((2, 3), "1"),
}  # fmt: skip
# Written for backward Euler, for several starts, for a noisy boundary, and for a solver that tells
# its trajectory and slips.
AT_TIMES = {
    "correction/steps_motion", "correction/steps_load", "starts/cost", "starts/NAME", "jitter/load",
    "jitter/image", "trajectory/times", "trajectory/displacement",
    "finer_trajectory/times", "finer_trajectory/displacement",
    "slip/images", "slip/grains", "slip/cells",
}  # fmt: skip


def test_an_identification_has_these_datasets_with_these_shapes_and_units(finished: Path) -> None:
    found = datasets(finished / "identify.h5")
    history = {name: found.pop(name) for name in tuple(found) if name.startswith("history/")}
    assert found == DATASETS
    record = json.loads((finished / "identify_history.json").read_text("utf-8"))
    every = {
        **dict(zip(NAMES, UNITS, strict=True)),
        **dict.fromkeys(
            ("cost", "chi_load", "chi_image", "paper_chi", "paper_chi_f", "paper_chi_F"), "1"
        ),
    }
    assert history == {
        f"history/{stage}/{name}": ((len(fit["iterations"]),), every[name])
        for stage, fit in record.items()
        for name in fit["iterations"][0]
    }
    # The apex amplitudes are held in stage B.
    assert {f"history/A/{name}" for name in every} <= set(history)
    assert not {f"history/B/{name}" for name in LAMBDAS} & set(history)


def test_strains_measured_without_a_law_are_those_of_the_identified_motion(finished: Path) -> None:
    with h5py.File(finished / "identify.h5") as found, h5py.File(finished / "measure.h5") as seen:
        image = int(found["measured_slip/image"][()])
        strain, sigma = (found[f"measured_slip/{name}"][:] for name in ("strain", "strain_sigma"))
        xy, motion = seen["xy"][:], found["final/motion"][image]
    grain = grains_at(read_med(finished / "mesh.med"), xy)
    for number in (0, 1):
        own = grain == number
        planes = np.column_stack([np.ones(own.sum()), xy[own]])
        (ux, vx, _), (uy, vy, _) = np.linalg.lstsq(planes, motion[own], rcond=None)[0][1:]
        away = (strain[number] - [ux, vy, uy + vx]) / sigma[number]
        assert np.abs(away).max() < 3.0
        assert vy > 5.0 * sigma[number, 1]


def test_every_dataset_of_an_identification_is_documented_and_no_other() -> None:
    assert documented_datasets("identify.h5") == {*DATASETS, *AT_TIMES, "history/STAGE/NAME"}


def test_names_units_and_words_of_an_identification_are_attributes(finished: Path) -> None:
    with h5py.File(finished / "identify.h5", "r") as file:
        told = dict(file.attrs)
        values = dict(zip(NAMES, file["values"][()], strict=True))
        assert [name.decode() for name in file["hessian_names"][()]] == [*LAMBDAS, *LAW]
    assert set(told) == {
        "prismid", "written", "names", "units", "all_values", "warnings", "reason", "converged",
    }  # fmt: skip
    assert json.loads(told["names"]) == NAMES and json.loads(told["units"]) == UNITS
    everything = json.loads(told["all_values"])
    assert everything == everything | values and everything["load_gain"] == 0.0
    assert told["converged"] in ("yes", "") and "σ" in told["reason"]


def test_the_datasets_of_an_identification_fit_each_other(finished: Path) -> None:
    with h5py.File(finished / "identify.h5", "r") as file:
        spread = np.sqrt(np.diag(file["covariance"][()]))
        product = file["correlation"][()] * np.outer(spread, spread)
        np.testing.assert_allclose(product, file["covariance"][()])
        # σ of a logarithm is relative: that of the law in units is p times that of θ.
        np.testing.assert_allclose(file["sigma"][-3:], file["values"][-3:] * spread[-3:])
        with h5py.File(finished / "measure.h5", "r") as measured:
            missed = measured["force"][()] - file["final/load"][()]
        np.testing.assert_allclose(file["final/load_residual"][()], missed)
        last = {name: file[f"history/C/{name}"][-1] for name in NAMES}
        np.testing.assert_array_equal(list(last.values()), file["values"][()])


def test_the_table_of_an_identification_has_a_free_parameter_a_row(finished: Path) -> None:
    with (finished / "identify.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["parameter", "value", "sigma", "unit", "model"]
    assert [row["parameter"] for row in rows] == NAMES
    assert [row["unit"] for row in rows] == UNITS
    with h5py.File(finished / "identify.h5", "r") as results:
        for column, name in (("value", "values"), ("sigma", "sigma")):
            told = [float(row[column]) for row in rows]
            np.testing.assert_allclose(told, results[name][()], rtol=1e-5)


def test_the_history_has_the_iterations_of_each_stage_and_why_it_ended(finished: Path) -> None:
    record = json.loads((finished / "identify_history.json").read_text("utf-8"))
    assert list(record) == ["A", "B", "C"]
    for fit in record.values():
        assert set(fit) == {"reason", "seconds", "iterations"} and "σ" in fit["reason"]
        assert fit["iterations"][-1]["cost"] <= fit["iterations"][0]["cost"]


def test_a_diagnosis_has_the_predictions_before_and_after(finished: Path) -> None:
    one = {"load": ((T,), "µN"), "load_residual": ((T,), "µN"), "motion": ((T, P, 3), "µm"),
           "rho": ((T, P), "µm")}  # fmt: skip
    assert datasets(finished / "diagnosis.h5") == {
        f"{side}/{name}": entry for side in ("before", "after") for name, entry in one.items()
    }


def every(path: Path) -> dict[str, np.ndarray]:
    """All datasets of a file."""
    with h5py.File(path, "r") as file:
        return {name: file[name][()] for name in datasets(path)}


def test_the_correction_and_the_noise_factor_are_those_that_were_written(finished: Path) -> None:
    held = every(finished / "identify.h5")
    correction = written_correction(held)
    np.testing.assert_array_equal(correction.motion, held["correction/motion"])
    np.testing.assert_array_equal(correction.load, held["correction/load"])
    assert correction.left_by_steps is None and correction.parts == held["correction/parts"]
    assert written_correction(held | {"correction/parts": np.array(3.0)}).parts == 3
    assert written_noise_factor(held) == held["noise_factor"]
    left = {"correction/steps_motion": np.ones((T, P, 3)), "correction/steps_load": np.arange(T)}
    steps = written_correction(held | left).left_by_steps
    assert steps is not None and steps.load[5] == 5.0 and steps.motion.shape == (T, P, 3)


def test_what_an_identification_did_not_write_is_none(finished: Path) -> None:
    """Neither had the boundary noise, nor does this solver tell its trajectory."""
    held = every(finished / "identify.h5")
    assert written_jitter(held) is None and written_trajectory(held) is None
    jitter = written_jitter({"jitter/load": np.eye(T), "jitter/image": np.zeros((T, T, 9))})
    assert jitter is not None and jitter.load.shape == (T, T) and jitter.image.shape == (T, T, 9)
    path = {"trajectory/times": np.arange(4.0), "trajectory/displacement": np.ones((4, 7, 3))}
    trajectory = written_trajectory(path)
    assert trajectory is not None and trajectory.displacement.shape == (4, 7, 3)
    np.testing.assert_array_equal(trajectory.times, np.arange(4.0))
    assert written_correction(held).course is None
    finer = {f"finer_{name}": values for name, values in path.items()}
    course = written_correction(held | finer).course
    assert course is not None and course.displacement.shape == (4, 7, 3)

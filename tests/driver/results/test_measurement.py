from __future__ import annotations

import csv
from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.driver.results.datasets import datasets, documented_datasets
from tools import closed_form

# Images, pixels used, nodes of u and v and of w, and their elements.
T, P, UV, W, CELLS_UV, CELLS_W = 44, 560, 8, 15, 3, 8
N = 2 * UV + W
DATASETS = {
    "time": ((T,), "s"), "stage": ((T,), "µm"), "cycle": ((T,), "1"), "force": ((T,), "µN"),
    "reference": (closed_form.SHAPE, "µm"), "pixel": ((), "µm"), "origin": ((2,), "pixel"),
    "xy": ((P, 2), "µm"), "rows": ((P,), "pixel"), "cols": ((P,), "pixel"),
    "gradient": ((P, 2), "1"), "sigma": ((), "µm"), "n_reference": ((), "1"),
    "noise_dof": ((), "1"), "sigma_flat": ((), "µm"),
    "codes": (closed_form.SHAPE, "0 USED, 1 DUST, 2 MASK, 3 TRENCH, 4 OUTSIDE"),
    "noise_frame": ((T,), "µm"), "noise_later": ((), "µm"), "noise_later_dof": ((), "1"),
    "noise_map": ((P,), "µm"), "noise_map_dof": ((), "1"), "noise_larger": ((P,), "1"),
    "rigid": ((T, 3), "µm"), "gain": ((T,), "1"), "left_out": ((T,), "1"), "phase": ((T,), "1"),
    "grip/nominal": ((), "1"), "grip/sigma": ((), "µm"), "grip/ratio": ((), "1"),
    "grip/unpenalised_sigma": ((), "µm"), "elongation_unpenalised": ((T,), "µm"),
    "grip/ratio_sigma": ((), "1"), "grip/scatter": ((), "1"),
    "motion": ((T, P, 3), "µm"), "coefficients": ((T, N), "µm"),
    "covariance_one": ((N, N), "µm²"), "nodes_uv": ((UV, 2), "µm"), "nodes_w": ((W, 2), "µm"),
    "cells_uv": ((CELLS_UV, 4), "1"), "cells_w": ((CELLS_W, 4), "1"),
    "residual": ((T, P), "µm"), "residual_over_noise": ((T, P), "1"), "chi": ((T,), "1"),
    "iterations": ((T,), "1"), "converged": ((T,), "1"), "stopped": ((T,), "text"),
    "penalty": ((), "text"), "roughness": ((), "µm"), "roughness_estimated": ((), "1"),
    "travel_length": ((), "µm"), "smoother": ((T, T), "1"),
}  # fmt: skip
for reading in ("elongation", "tilt", "mean_w"):
    DATASETS[reading] = ((T,), "µm")
    DATASETS[f"{reading}_covariance"] = ((T, T), "µm²")
    DATASETS |= {f"{reading}_{part}": ((), "µm") for part in ("sigma", "single", "held")}


def test_a_measurement_has_these_datasets_with_these_shapes_and_units(finished: Path) -> None:
    assert datasets(finished / "measure.h5") == DATASETS


def test_every_dataset_of_a_measurement_is_documented_and_no_other() -> None:
    assert documented_datasets("measure.h5") == set(DATASETS)


def test_a_measurement_tells_its_version_and_when_it_was_written(finished: Path) -> None:
    with h5py.File(finished / "measure.h5", "r") as file:
        assert set(file.attrs) == {"prismid", "written"}
        assert file.attrs["written"].endswith("+00:00")


def test_the_table_of_a_measurement_is_the_same_in_nanometres_an_image_a_row(
    finished: Path,
) -> None:
    with (finished / "measure.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == T and list(rows[0]) == [
        "image", "time_s", "stage_um", "force_uN", "elongation_nm", "tilt_nm", "chi",
        "shift_X_nm", "shift_Y_nm", "shift_Z_nm", "gain", "left_out", "converged", "stopped",
    ]  # fmt: skip
    with h5py.File(finished / "measure.h5", "r") as file:
        columns = {
            "time_s": file["time"][()], "stage_um": file["stage"][()],
            "force_uN": file["force"][()], "elongation_nm": 1e3 * file["elongation"][()],
            "tilt_nm": 1e3 * file["tilt"][()], "chi": file["chi"][()],
            "shift_X_nm": 1e3 * file["rigid"][:, 0], "shift_Z_nm": 1e3 * file["rigid"][:, 2],
            "gain": file["gain"][()],
            "left_out": file["left_out"][()], "converged": file["converged"][()],
        }  # fmt: skip
        stopped = [text.decode() for text in file["stopped"][()]]
    for name, values in columns.items():
        told = [float(row[name]) for row in rows]
        np.testing.assert_allclose(told, values, rtol=1e-5, err_msg=name)
    assert [row["stopped"] for row in rows] == stopped
    assert [row["image"] for row in rows] == [str(image) for image in range(T)]


def test_the_datasets_of_a_measurement_fit_each_other(finished: Path) -> None:
    """Pixels lie where rows and columns say, and the motion is that of the nodes."""
    with h5py.File(finished / "measure.h5", "r") as file:
        place = np.column_stack([file["rows"][()], file["cols"][()]]) - file["origin"][()]
        np.testing.assert_allclose(file["xy"][()], place * file["pixel"][()], atol=1e-12)
        used = file["codes"][()] == 0
        assert np.count_nonzero(used) == P and used[file["rows"][()], file["cols"][()]].all()
        np.testing.assert_allclose(file["mean_w"][()], file["motion"][..., 2].mean(axis=1))
        np.testing.assert_allclose(file["rigid"][()], file["motion"][()].mean(axis=1))
        variance = np.diag(file["elongation_covariance"][()])
        sigma = np.sqrt(np.median(variance) + file["elongation_held"][()] ** 2)
        assert file["elongation_sigma"][()] == pytest.approx(sigma, rel=1e-6)
        assert bytes(file["penalty"][()]).decode() == "tikhonov"

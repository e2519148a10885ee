from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import tifffile

from driver.experiment.history import History
from driver.results.hdf5 import prismid_version
from driver.results.virtual_experiment import Truth, write_history, write_images, write_truth

T, ROWS, COLUMNS, NODES = 2, 3, 5, 4
UNITS = {
    "x": ((ROWS, COLUMNS), "µm"), "y": ((ROWS, COLUMNS), "µm"), "relief": ((ROWS, COLUMNS), "µm"),
    "pattern": ((ROWS, COLUMNS), "µm"), "noise": ((ROWS, COLUMNS), "µm"), "stage": ((T, 3), "µm"),
    "motion": ((T, ROWS, COLUMNS, 3), "µm"), "load": ((T,), "µN"), "nodes": ((NODES, 2), "µm"),
    "nodal_motion": ((T, NODES, 3), "µm"),
}  # fmt: skip


def test_the_truth_is_datasets_with_units_and_parameters_with_theirs(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    arrays = {name: rng.normal(size=shape) for name, (shape, _) in UNITS.items()}
    truth = Truth(
        seed=3, values={"tau0": 44.0, "load_gain": 0.01}, units={"tau0": "MPa", "load_gain": ""},
        origin_error=np.array([0.02, -0.03]), n_cells=700, settings={"microscope": {"bits": 8}},
        **arrays,
    )  # fmt: skip
    write_truth(tmp_path, truth)
    with h5py.File(tmp_path / "truth.h5", "r") as file:
        found = {name: (data.shape, data.attrs["unit"]) for name, data in file.items()}
        assert found == UNITS
        for name, array in arrays.items():
            single = array.astype(np.float32) if name == "motion" else array
            np.testing.assert_array_equal(file[name][()], single)
    assert json.loads((tmp_path / "truth.json").read_text("utf-8")) == {
        "prismid": prismid_version(), "seed": 3,
        "values": {
            "tau0": {"value": 44.0, "unit": "MPa"}, "load_gain": {"value": 0.01, "unit": ""},
        },
        "origin_error_um": [0.02, -0.03], "n_cells": 700, "settings": {"microscope": {"bits": 8}},
    }  # fmt: skip


def test_the_history_has_forces_at_its_images_and_at_no_other_row(tmp_path: Path) -> None:
    rows = np.array([0, 2])
    history = History(
        time=np.array([0.0, 10.0, 40.0]), stage=np.array([0.0, 5.0, 5.0]), image_row=rows,
        force=np.zeros(2), turning=np.array([0, 2]), cycle=np.ones(2, dtype=np.int64),
    )  # fmt: skip
    write_history(tmp_path, history, np.array([0.00004, 12.34567]))
    assert (tmp_path / "history.csv").read_text("utf-8").splitlines() == [
        "time_s,stage_um,image,force_N", "0,0,0,0.0000", "10,5,,", "40,5,1,12.3457",
    ]  # fmt: skip


def test_each_stack_is_a_file_of_levels_in_its_order(tmp_path: Path) -> None:
    levels = np.arange(24, dtype=np.uint8).reshape(4, 2, 3)
    write_images(tmp_path, list(levels), list(levels[:2] + 100), list(levels[:1] + 200))
    for name, expected in (
        ("images.tif", levels), ("repeats.tif", levels[:2] + 100), ("flats.tif", levels[:1] + 200),
    ):  # fmt: skip
        stack = tifffile.imread(tmp_path / name)
        assert stack.dtype == np.uint8
        np.testing.assert_array_equal(stack.reshape(expected.shape), expected)

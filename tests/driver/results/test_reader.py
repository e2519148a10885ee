from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.results.hdf5 import ResultError
from driver.results.reader import read_results

READ = ("mesh.med", "measure.h5", "identify.h5", "diagnosis.json", "diagnosis.h5")


@pytest.fixture
def copied(finished: Path, tmp_path: Path) -> Path:
    """The results that are read, to be changed."""
    for name in READ:
        shutil.copy(finished / name, tmp_path / name)
    return tmp_path


def test_the_identified_model_is_read_with_its_predictions_and_its_start(finished: Path) -> None:
    found = read_results(finished, diagnosed=False)
    (model,) = found.models
    assert not found.diagnosed and model.label == "model"
    with h5py.File(finished / "identify.h5", "r") as file:
        names = json.loads(file.attrs["names"])
        for name in ("load", "load_residual", "motion", "rho"):
            np.testing.assert_array_equal(getattr(model, name), file[f"final/{name}"][()])
        assert found.start == dict(zip(names, file["start"][()], strict=True))
        assert model.sigma == dict(zip(names, file["sigma"][()], strict=True))
        assert model.values == json.loads(file.attrs["all_values"])
    assert model.units["tau0"] == "MPa" and model.units["tilt_1"] == "µm"
    with h5py.File(finished / "measure.h5", "r") as file:
        np.testing.assert_array_equal(found.measured["motion"], file["motion"][()])
    assert found.mesh.n_grains == 2


def test_the_extended_model_has_its_own_values_and_those_of_the_identified_one_beside(
    finished: Path,
) -> None:
    found = read_results(finished, diagnosed=True)
    identified, extended = found.models
    assert found.diagnosed and extended.label == "extended"
    record = json.loads((finished / "diagnosis.json").read_text("utf-8"))["extended"]["values"]
    assert set(extended.sigma) == set(identified.sigma) | {"stretch_curvature"}
    for name, entry in record.items():
        told = extended.values[name], extended.sigma[name], extended.units[name]
        assert told == (entry["value"], entry["sigma"], entry["unit"])
    held = set(identified.values) - set(record)
    assert held and all(extended.values[name] == identified.values[name] for name in held)
    with h5py.File(finished / "diagnosis.h5", "r") as file:
        np.testing.assert_array_equal(extended.rho, file["after/rho"][()])


def replaced(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Path], None]:
    """Replace a dataset; `name` is that of the file and of the dataset."""

    def damage(folder: Path) -> None:
        file_name, dataset = name.split(":")
        with h5py.File(folder / file_name, "a") as file:
            content = file[dataset][()]
            del file[dataset]
            file[dataset] = change(content)

    return damage


def without_sigma(folder: Path) -> None:
    record = json.loads((folder / "diagnosis.json").read_text("utf-8"))
    del record["extended"]["values"]["tau0"]["sigma"]
    (folder / "diagnosis.json").write_text(json.dumps(record), encoding="utf-8")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (replaced("measure.h5:motion", lambda a: a[..., :2]),
         r"measure.h5: found motion of shape \(44, 560, 2\) in place of \(44, 560, 3\)"),
        (replaced("measure.h5:xy", lambda a: a.astype("S")), "measure.h5: found no numbers xy"),
        (replaced("identify.h5:final/rho", lambda a: a[:, 1:]),
         r"identify.h5: found final/rho of shape \(44, 559\) in place of \(44, 560\)"),
        (replaced("identify.h5:start", lambda a: a[1:]),
         r"identify.h5: found start of shape \(16,\) in place of \(17\)"),
        (replaced("diagnosis.h5:after/load", lambda a: a[:5]),
         r"diagnosis.h5: found after/load of shape \(5,\) in place of \(44\)"),
        (without_sigma, "diagnosis.json: found no readable extended model"),
    ],
)  # fmt: skip
def test_results_that_do_not_fit_each_other_are_damaged(
    damage: Callable[[Path], None], said: str, copied: Path
) -> None:
    damage(copied)
    with pytest.raises(ResultError, match=said):
        read_results(copied, diagnosed=True)

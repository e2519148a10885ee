"""Labelled results beside the files that the stages have written, read with h5py, csv and json."""

from __future__ import annotations

import csv
import json
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

import prismid
from driver.case.model import load_case
from driver.workflow.engine import stage_keys
from driver.workflow.pipeline import stages
from tests.driver.invented_results import Results, results, written
from tests.prismid.conftest import ALPHA

__all__ = ["results", "written"]  # fixtures

OUTPUTS = {
    "mesh": ["mesh.med"],
    "measure": ["measure.h5"],
    "identify": ["identify.h5"],
    "diagnose": ["diagnosis.json", "diagnosis.h5"],
    "advise": ["advice.json"],
}


def record(folder: Path, *done: str) -> None:
    """What a run would have written after these stages."""
    case = load_case(folder / "case.toml")
    keys = stage_keys(stages(case), case)
    entries = {
        name: {"key": keys[name], "outputs": OUTPUTS[name], "finished": "", "seconds": 1.0}
        for name in done
    }
    (folder / "results" / "stages.json").write_text(json.dumps(entries), encoding="utf-8")


@pytest.fixture
def diagnosed(results: Results) -> Path:
    """The folder of a case whose diagnosis is finished."""
    found = results.results
    with h5py.File(found / "diagnosis.h5") as source, h5py.File(found / "identify.h5", "a") as to:
        for name in ("load", "motion", "rho"):
            to[f"final/{name}"] = source[f"before/{name}"][()]
        to["sigma"] = np.arange(1.0, len(to["values"]) + 1)
    record(results.folder, "mesh", "measure", "identify", "diagnose")
    return results.folder


def test_the_motion_of_the_face_has_coordinates_and_units(alpha: Path) -> None:
    found = prismid.read_results(alpha)
    assert set(found.children) == {"images", "surface"}
    surface = found["surface"].to_dataset()
    with h5py.File(alpha / "results" / "measure.h5") as file:
        np.testing.assert_array_equal(surface.motion, file["motion"][()])
        np.testing.assert_array_equal(surface.motion.sel(component="w"), file["motion"][..., 2])
        np.testing.assert_array_equal(surface.coords["X"], file["xy"][:, 0])
        assert surface.residual.attrs["sigma"] == file["sigma"][()]
    assert surface.motion.dims == ("image", "point", "component")
    assert {name: surface[name].units for name in ("motion", "residual", "X", "Y", "time")} == {
        "motion": "µm", "residual": "µm", "X": "µm", "Y": "µm", "time": "s",
    }  # fmt: skip


def test_loads_and_elongation_are_those_of_the_table(alpha: Path) -> None:
    with (alpha / "results" / "measure.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    images = prismid.read_results(alpha)["images"]
    for name, column, factor in (
        ("load_measured", "force_uN", 1.0),
        ("elongation", "elongation_nm", 1e3),
        ("time", "time_s", 1.0),
        ("stage", "stage_um", 1.0),
    ):
        told = [float(row[column]) for row in rows]
        np.testing.assert_allclose(factor * images[name], told, rtol=1e-5, atol=1e-9)
    assert images["load_measured"].attrs == {"units": "µN", "long_name": "load", "sigma": 5.97}


def test_identified_parameters_have_sigma_and_covariance(diagnosed: Path) -> None:
    found = prismid.read_results(diagnosed / "case.toml")["parameters"].to_dataset()
    with h5py.File(diagnosed / "results" / "identify.h5") as file:
        names = json.loads(file.attrs["names"])
        sigma, correlation = file["sigma"][()], file["correlation"][()]
        np.testing.assert_array_equal(found["value"], file["values"][()])
        np.testing.assert_array_equal(found["start"], file["start"][()])
        np.testing.assert_array_equal(found["prior_share"], file["prior_share"][()])
    assert list(found["parameter"].values) == names
    c, d = names.index("c"), names.index("d")
    at = found["covariance"].sel(parameter="c", with_parameter="d")
    assert float(at) == pytest.approx(sigma[c] * sigma[d] * correlation[c, d])
    np.testing.assert_allclose(np.diag(found["covariance"]), sigma**2)
    assert found.attrs["converged"] == 1 and len(found.attrs["warnings"]) == 2
    assert str(found["label"].sel(parameter="tau0").values) == "τ₀"


def test_the_diagnosis_is_a_table_of_causes_by_round(diagnosed: Path) -> None:
    found = prismid.read_results(diagnosed)
    causes = found["causes"]
    told = json.loads((diagnosed / "results" / "diagnosis.json").read_text("utf-8"))
    first = {cause["cause"]: cause for cause in told["steps"][0]["causes"]}
    assert causes.attrs["verdict"] == "named" and causes.attrs["named"] == ["grain_contrast"]
    for name, cause in first.items():
        row = causes.to_dataset().sel(round=1, cause=name)
        assert float(row.log_evidence) == cause["log_evidence"]
        assert float(row.p_family) == cause["p_family"]
        assert str(row.category.values) == cause["category"]
        assert bool(row.named) == (name in ("grain_contrast", "family_112"))
    refits = causes["log_evidence_refit"].sel(round=1).dropna("cause")
    assert dict(zip(refits["cause"].values, refits.values, strict=True)) == {
        "grain_contrast": 300.0, "family_112": 100.0,
    }  # fmt: skip
    # What a round has not tried, it tells nothing of.
    assert np.isnan(causes["statistic"].sel(round=2, cause="grain_contrast"))
    extended = found["extended"].to_dataset().sel(parameter="tau0_grain2")
    assert (float(extended.value), float(extended.sigma)) == (1.1493, 0.0041)
    assert found["extended"].attrs["added"] == ["tau0_grain2"]


def test_parameters_of_causes_have_what_was_seen_and_what_would_have_been(
    diagnosed: Path,
) -> None:
    effects = prismid.read_results(diagnosed)["effects"].to_dataset()
    told = json.loads((diagnosed / "results" / "diagnosis.json").read_text("utf-8"))
    first = told["steps"][0]["causes"]
    pairs = [(cause["cause"], name) for cause in first for name in cause["parameters"]]
    assert list(zip(effects.cause.values, effects.parameter.values, strict=True)) == pairs
    one = effects.sel(round=1)
    contrast = one.isel(effect=pairs.index(("grain_contrast", "tau0_grain2")))
    assert (float(contrast.estimate), float(contrast.smallest_visible)) == (0.14, 0.02)
    assert (float(contrast.value), float(contrast.sigma)) == (1.1493, 0.0041)
    drift = one.isel(effect=[cause for cause, _ in pairs].index("load_drift"))
    assert np.isnan(drift.smallest_visible) and np.isnan(drift.value)


def test_models_stand_beside_the_measurement(diagnosed: Path) -> None:
    found = prismid.read_results(diagnosed)
    with h5py.File(diagnosed / "results" / "diagnosis.h5") as file:
        for label, side in (("model", "before"), ("extended", "after")):
            np.testing.assert_array_equal(found["images"][f"load_{label}"], file[f"{side}/load"])
            rho = found["surface"][f"residual_{label}"]
            np.testing.assert_array_equal(rho, file[f"{side}/rho"])


def test_results_of_stages_that_are_not_finished_are_absent(diagnosed: Path) -> None:
    record(diagnosed, "mesh", "measure", "identify")
    found = prismid.read_results(diagnosed)
    assert set(found.children) == {"images", "surface", "parameters"}
    assert "load_model" in found["images"] and "load_extended" not in found["images"]


def test_a_case_that_was_not_run_is_told_what_makes_its_results(diagnosed: Path) -> None:
    record(diagnosed)
    with pytest.raises(prismid.InputError, match=r"stage measure: found no results.*prismid run"):
        prismid.read_results(diagnosed)


@pytest.mark.parametrize("name", ["steps", "extended", "text"])
def test_a_diagnosis_without_an_entry_is_told_in_a_sentence(diagnosed: Path, name: str) -> None:
    path = diagnosed / "results" / "diagnosis.json"
    told = json.loads(path.read_text("utf-8"))
    del told[name]
    path.write_text(json.dumps(told), encoding="utf-8")
    with pytest.raises(prismid.InputError, match=rf"diagnosis\.json: found no .*'{name}'"):
        prismid.read_results(diagnosed)


def test_a_file_without_a_dataset_is_told_in_a_sentence(diagnosed: Path) -> None:
    with h5py.File(diagnosed / "results" / "measure.h5", "a") as file:
        del file["force"]
    with pytest.raises(prismid.InputError, match=r"measure\.h5: found no dataset force, expected"):
        prismid.read_results(diagnosed)


@pytest.fixture
def of_loads(tmp_path: Path) -> Path:
    """The folder of a case without images whose identification is finished."""
    for name in ("case.toml", "history.csv"):
        shutil.copy(ALPHA / name, tmp_path / name)
    ratio = {"boundary.stage_ratio": 6.8e-4, "boundary.stage_ratio_uncertainty": 1e-5}
    case = prismid.changed(tmp_path, {"boundary.motion": "stage", **ratio})
    prismid.write_case(case, tmp_path / "case.toml")
    (tmp_path / "results").mkdir()
    load = np.array([0.0, 310.0, 120.0])
    datasets = {
        "time": [0.0, 40.0, 80.0], "stage": [0.0, 10.0, 4.0], "cycle": [1, 1, 1], "force": load,
        "final/load": load + 2.0, "initial/load": load + 50.0, "sigma": [0.5], "start": [40.0],
        "values": [21.0], "correlation": [[1.0]], "prior_share": [0.01],
    }  # fmt: skip
    with h5py.File(tmp_path / "results" / "identify.h5", "w") as file:
        for name, values in datasets.items():
            file[name] = values
        file.attrs.update(names='["tau0"]', units='["MPa"]', all_values='{"tau0": 21.0}',
                          warnings="[]", reason="", converged="yes")  # fmt: skip
    record(tmp_path, "identify")
    return tmp_path


def test_a_case_without_images_has_loads_and_parameters(of_loads: Path) -> None:
    found = prismid.read_results(of_loads)
    assert set(found.children) == {"images", "parameters"}
    images = found["images"].to_dataset()
    assert images.load_measured.values.tolist() == [0.0, 310.0, 120.0]
    assert images.load_model.values.tolist() == [2.0, 312.0, 122.0]
    assert float(found["parameters"]["value"].sel(parameter="tau0")) == 21.0
    assert list(prismid.figures(of_loads)) == ["report_loads"]


def test_without_xarray_the_extra_is_named(
    diagnosed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "xarray", None)
    with pytest.raises(prismid.InputError, match=r'expected `pip install "prismid\[xarray\]"`'):
        prismid.read_results(diagnosed)

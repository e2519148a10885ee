"""`prismid design` on a case whose test has not been made, with the solver in closed form."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest

from driver.case.model import load_case, write_case
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.design import command
from driver.design.command import design
from driver.design.forecast import Forecast, Plan, whole_forecast
from driver.forward import build
from solver_adapters.interface import SolverError
from tools import closed_form

RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results.md"
SETTINGS = """
[program]
cycles = [[6, 2], [6, 2]]
[what_if.quiet.loads]
noise_uN = 0.5
"""


@pytest.fixture(scope="module", autouse=True)
def closed() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver(0.001)
        )
        yield


def write(folder: Path) -> Path:
    """A case without images, loads or history, and settings that say what is planned."""
    write_case(closed_form.small_case(), folder / "case.toml")
    (folder / "settings.toml").write_text(SETTINGS, encoding="utf-8")
    return folder / "case.toml"


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any], list[str]]:
    """The results, the record, and what was told."""
    folder = tmp_path_factory.mktemp("design")
    lines: list[str] = []
    case = write(folder)
    with progress_to(lines.append):
        design(case, folder / "settings.toml", ["test.holds=3"], True)
    results = folder / "results"
    return results, json.loads((results / "design.json").read_text(encoding="utf-8")), lines


def changes(record: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return {change["name"]: change for change in record["changes"]}


def test_nothing_of_an_experiment_needs_to_be_there(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    _, record, lines = found
    assert "no repeats yet" in record["surface"]
    assert record["experiment"]["n_images"] == 17
    names = [p["parameter"] for p in record["experiment"]["parameters"]]
    assert {"tau0", "c", "d", "lambda_plus_Y", "elongation_4", "tilt_1"} <= set(names)
    assert len(record["experiment"]["causes"]) > 20
    assert any(line.startswith("tau0") and "%" in line for line in lines)


def test_time_and_memory_are_told_before_and_the_way_while_it_runs(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    lines = found[2]
    # The case, four usual changes of test and specimen, and the one that was given.
    assert lines[0].startswith("the case and 11 changes: 6 of them simulated")
    assert "on free cores" in lines[0] and "GB of memory" in lines[0]
    assert sum(": simulated; " in line for line in lines) == 5
    assert any(line.startswith("  5 of 5, ") and line.endswith("0 s to go") for line in lines)


def test_the_usual_changes_are_compared_with_those_of_settings_and_command_line(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    _, record, lines = found
    assert len(record["changes"]) == 11
    named = changes(record)
    assert named["quiet"]["change"] == "loads.noise_uN=0.5"
    # Half the load noise is the same change: the same numbers, though found on their own.
    assert named["quiet"]["gain"] == named["half the load noise"]["gain"]
    assert named["test.holds=3"]["duration_s"] > record["experiment"]["duration_s"]
    assert named["twice the stops"]["n_images"] == 33
    assert sum(line.startswith("[") for line in lines) == 11


def test_what_a_change_buys_is_the_ratio_of_both_records(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    record = found[1]
    before = {p["parameter"]: p["sigma_theta"] for p in record["experiment"]["parameters"]}
    for change in record["changes"]:
        after = {p["parameter"]: p["sigma_theta"] for p in change["parameters"]}
        for name, ratio in change["gain"]["sigma_ratio"].items():
            assert ratio == pytest.approx(after[name] / before[name])


def test_less_noise_and_more_images_know_no_less(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    named = changes(found[1])
    for name in ("two images a stop", "half the load noise", "half the height noise",
                 "twice the repeats", "an exact simulation"):  # fmt: skip
        assert max(named[name]["gain"]["sigma_ratio"].values()) <= 1 + 1e-9, name


def test_a_case_that_asks_for_causes_without_a_sensitivity_has_a_design(
    tmp_path: Path, lines: list[str]
) -> None:
    """A flip of the EBSD frame and the noises have none."""
    path = write(tmp_path)
    case = load_case(path)
    table = case.diagnosis.model_copy(update={"causes": ("ebsd_flip_x", "boundary_noise")})
    write_case(case.model_copy(update={"diagnosis": table}), path)
    design(path, tmp_path / "settings.toml", [], False)
    assert "none of the causes that the case asks for can be forecast" in lines
    assert (tmp_path / "results" / "design.png").is_file()


def test_every_key_of_the_record_is_documented(
    found: tuple[Path, dict[str, Any], list[str]],
) -> None:
    section = RESULTS.read_text(encoding="utf-8").split("## `design.json`")[1].split("\n## ")[0]
    change = found[1]["changes"][0]
    tables = (
        found[1], change, change["gain"], change["parameters"][0], change["causes"][0],
        change["causes"][0]["parameters"][0],
    )  # fmt: skip
    for table in tables:
        for key in table:
            assert f"`{key}`" in section, key


def test_the_picture_is_drawn(found: tuple[Path, dict[str, Any], list[str]]) -> None:
    picture = matplotlib.image.imread(found[0] / "design.png")
    assert picture.shape[1] > 1500 and picture.std() > 0.05


def test_no_more_than_the_case_is_asked_without_the_usual_changes(
    tmp_path: Path, lines: list[str]
) -> None:
    case = write(tmp_path)
    (tmp_path / "settings.toml").write_text("[program]\ncycles = [[4, 2]]", encoding="utf-8")
    design(case, tmp_path / "settings.toml", [], False)
    record = json.loads((tmp_path / "results" / "design.json").read_text(encoding="utf-8"))
    assert record["changes"] == [] and lines[0].startswith("the case and 0 changes")
    assert matplotlib.image.imread(tmp_path / "results" / "design.png").std() > 0.05


def test_a_change_that_cannot_be_simulated_costs_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    def fails(plan: Plan) -> Forecast:
        if plan.variant.test.compression:
            raise SolverError("the specimen buckles\nin the second line")
        return whole_forecast(plan)

    monkeypatch.setattr(command, "whole_forecast", fails)
    asked = ["test.compression=true", "test.holds=3"]
    design(write(tmp_path), tmp_path / "settings.toml", asked, False)
    assert any("test.compression=true: failed: the specimen buckles;" in line for line in lines)
    record = json.loads((tmp_path / "results" / "design.json").read_text(encoding="utf-8"))
    assert set(changes(record)) == {"quiet", "test.holds=3"}


def test_a_fault_of_the_program_in_a_change_is_raised(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def faulty(plan: Plan) -> Forecast:
        raise ValueError("operands could not be broadcast together")

    monkeypatch.setattr(command, "whole_forecast", faulty)
    with pytest.raises(ValueError, match="broadcast"):
        design(write(tmp_path), tmp_path / "settings.toml", ["test.holds=3"], False)


def test_a_history_without_loads_serves(tmp_path: Path) -> None:
    closed_form.write_files(tmp_path, {})
    (tmp_path / "images.tif").unlink()
    history = tmp_path / "history.csv"
    rows = [line.split(",") for line in history.read_text(encoding="utf-8").splitlines()]
    bare = "\n".join(",".join(row[:3]) for row in rows)
    history.write_text(bare, encoding="utf-8")
    design(tmp_path / "case.toml", None, [], False)
    record = json.loads((tmp_path / "results" / "design.json").read_text(encoding="utf-8"))
    assert record["experiment"]["n_images"] == closed_form.history().n_images
    assert np.all(np.isfinite(record["experiment"]["load_uN"]))
    assert record["noise_nm"] == pytest.approx(1e3 * closed_form.SIGMA, rel=0.05)


def test_where_no_test_is_planned_the_sentence_says_how_to_plan_one(tmp_path: Path) -> None:
    with pytest.raises(InputError) as error:
        design(write(tmp_path), None, [], False)
    assert "history.csv: file: found nothing, expected a CSV file" in str(error.value)
    assert "or `cycles` under [program] of --settings" in str(error.value)


def test_an_assumed_parameter_that_is_not_of_the_model_is_refused(tmp_path: Path) -> None:
    case = write(tmp_path)
    with (tmp_path / "settings.toml").open("a", encoding="utf-8") as file:
        file.write("[truth]\ntau = 3.0\n")
    with pytest.raises(InputError, match='truth: found the name "tau", expected tau0'):
        design(case, tmp_path / "settings.toml", [], False)


def test_the_repeats_of_the_settings_count_for_the_case_too(tmp_path: Path) -> None:
    case = write(tmp_path)
    with (tmp_path / "settings.toml").open("a", encoding="utf-8") as file:
        file.write("[test]\nrepeats = 3\n")
    design(case, tmp_path / "settings.toml", ["test.repeats=10"], False)
    record = json.loads((tmp_path / "results" / "design.json").read_text(encoding="utf-8"))
    ratios = changes(record)["test.repeats=10"]["gain"]["sigma_ratio"]
    assert max(ratios.values()) <= 1 + 1e-9 and min(ratios.values()) < 0.95
    assert load_case(case).images.repeats is not None

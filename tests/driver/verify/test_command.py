"""`prismid verify` as a user calls it, on a case whose solver has a closed form."""

from __future__ import annotations

import hashlib
import json
import shutil
from datetime import datetime
from pathlib import Path

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner, Result

from driver.case.model import load_case, write_case
from driver.cli import app
from driver.common.progress import quiet
from driver.forward import build
from driver.results.hdf5 import write_csv, write_hdf5
from driver.verify import command
from driver.workflow import pipeline
from driver.workflow.engine import Stage, StageContext, run_stages
from driver.workflow.mesh_stage import run_mesh
from tools import closed_form


def measured(context: StageContext) -> None:
    """Write a few numbers of the case in the formats of a measurement."""
    pixel = context.case.images.pixel_um
    elongation = np.sin(np.arange(12.0)) * pixel
    write_hdf5(context.workdir / "measure.h5", {"elongation": (elongation, "µm")})
    write_csv(context.workdir / "measure.csv", {"image": range(12), "nm": 1e3 * elongation})


def drawn(context: StageContext) -> None:
    (context.workdir / "report.html").write_text(f"{datetime.now()}", encoding="utf-8")


STAGES = (
    Stage("mesh", "1", ("specimen",), run_mesh),
    Stage("measure", "1", ("images",), measured),
    Stage("diagnose", "1", ("diagnosis",), drawn),
    Stage("report", "1", (), drawn),
)


@pytest.fixture
def stored(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A case of which the stages mesh and measure have run."""
    closed_form.write_files(tmp_path, {"tau0": 44.0})
    monkeypatch.setattr(command, "stages", lambda case: STAGES)
    with quiet():
        run_stages(load_case(tmp_path / "case.toml"), STAGES, "measure")
    return tmp_path


@pytest.mark.slow
def test_results_of_the_real_stages_agree_with_themselves(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver(0.001)
    )
    closed_form.write_files(tmp_path, {"stretch_curvature": 0.1, "tau0": 44.0})
    with quiet():
        pipeline.run(tmp_path / "case.toml")
    found = command.verify(tmp_path)
    assert found.same_machine and found.agrees
    names = {file.name for file in found.files}
    assert {"measure.h5", "identify.h5", "diagnosis.json", "diagnosis.h5", "advice.json"} <= names
    assert all(file.comparison and not file.comparison.largest for file in found.files)


def verified(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["verify", *map(str, arguments)])


def contents(folder: Path) -> dict[str, str]:
    """Hash and time of change of every file."""
    return {
        str(path): f"{hashlib.sha256(path.read_bytes()).hexdigest()} {path.stat().st_mtime_ns}"
        for path in folder.rglob("*")
        if path.is_file()
    }


def record(folder: Path) -> dict[str, dict[str, object]]:
    read: dict[str, dict[str, object]] = json.loads(
        (folder / "results" / "stages.json").read_text("utf-8")
    )
    return read


def test_results_agree_with_themselves_to_the_last_digit_and_are_left_as_they_are(
    stored: Path,
) -> None:
    before = contents(stored)
    done = verified(stored / "results")
    assert done.exit_code == 0, done.output
    assert "all stages take about" in done.stdout and "diagnose: no results" in done.stdout
    rows = [line.split() for line in done.stdout.splitlines() if line.rstrip().endswith(" agrees")]
    assert [row[1] for row in rows] == ["mesh.med", "mesh_fine.med", "measure.csv", "measure.h5"]
    assert all(count == same and largest == "0" for _, _, count, same, largest, _ in rows)
    assert f"{stored / 'results'}: 4 files agree (to the last digit" in done.stdout
    assert contents(stored) == before


def change(path: Path, times: float, mended: bool) -> None:
    """Change a digit of a result, and the hash that is kept of it."""
    with h5py.File(path, "a") as file:
        file["elongation"][3] *= times
    if mended:
        entries = record(path.parents[1])
        digests = entries["measure"]["digests"]
        assert isinstance(digests, dict)
        digests[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()
        (path.parent / "stages.json").write_text(json.dumps(entries), "utf-8")


def test_a_changed_digit_is_found_and_named(stored: Path) -> None:
    change(stored / "results" / "measure.h5", 1.0 + 1e-12, mended=False)
    done = verified(stored / "case.toml", "--until", "measure")
    assert done.exit_code == 1
    named = [line for line in done.stdout.splitlines() if "measure.h5: " in line][-2:]
    assert "has changed since its stage wrote it" in named[0]
    assert "elongation[3]: stored 0.01" in named[1] and "e-13)" in named[1]
    assert "measure.h5   " in done.stdout and " DIFFERS" in done.stdout
    assert "do NOT all agree" in done.stdout


@pytest.mark.parametrize(("times", "code"), [(1.0 + 1e-9, 0), (1.0 + 1e-4, 1)])
def test_results_of_another_machine_agree_within_the_tolerance(
    stored: Path, times: float, code: int
) -> None:
    change(stored / "results" / "measure.h5", times, mended=True)
    entries = record(stored)
    for entry in entries.values():
        entry["machine"] = "another one"
    (stored / "results" / "stages.json").write_text(json.dumps(entries), "utf-8")
    done = verified(stored)
    assert done.exit_code == code
    assert "the run was on another machine" in done.stdout
    assert ("elongation[3]" in done.stdout) == bool(code)


def test_a_result_that_is_gone_or_damaged_differs(stored: Path) -> None:
    (stored / "results" / "measure.csv").unlink()
    (stored / "results" / "measure.h5").write_bytes(b"\x89HDF\r\n\x1a\n")
    done = verified(stored)
    assert done.exit_code == 1
    assert "measure.csv: is not there" in done.stdout
    assert "measure.h5: cannot be read" in done.stdout


def test_results_of_another_state_of_the_case_are_no_results_of_it(stored: Path) -> None:
    case = load_case(stored / "case.toml")
    write_case(case.with_values_at({"images.height_per_level_nm": 7.0}), stored / "case.toml")
    asked = verified(stored, "--until", "measure")
    assert asked.exit_code == 1
    assert "stage measure: found results of another state ([images] has changed)" in asked.stderr


def test_results_that_were_put_elsewhere_are_the_ones_that_are_compared(stored: Path) -> None:
    """As `run --results` puts them, beside the case or anywhere."""
    beside, away = stored / "second", stored.parent / "away"
    for folder in (beside, away):
        shutil.copytree(stored / "results", folder)
        change(folder / "measure.h5", 1.0 + 1e-12, mended=False)
    asked = verified(away)
    assert asked.exit_code == 1 and "name it, and them by --results" in asked.stderr
    for done, folder in (
        (verified(beside), beside),
        (verified(stored / "case.toml", "--results", away), away),
    ):
        assert done.exit_code == 1, done.output
        assert f"{folder / 'measure.h5'}: elongation[3]: stored" in done.stdout
        assert f"{folder}: 4 files do NOT all agree" in done.stdout
    assert verified(stored / "results").exit_code == 0


def test_stages_without_results_are_no_results(stored: Path) -> None:
    assert "stage diagnose: found no results" in verified(stored, "--until", "diagnose").stderr
    other = verified(stored, "--until", "measured")
    assert other.exit_code == 2 and 'found "measured", expected one of mesh' in other.stderr
    (stored / "case.toml").rename(stored / "other.toml")
    asked = verified(stored / "results")
    assert (
        asked.exit_code == 1 and "case.toml: file: found nothing, expected the case" in asked.stderr
    )

"""How far a case is, as its record, its results and its lock tell it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from driver.case.model import default_case, write_case
from driver.cli import app
from driver.status.command import status_of
from driver.workflow.pipeline import run
from driver.workflow.run_lock import holder, sole_run


@pytest.fixture
def case(tmp_path: Path) -> Path:
    """A case of which the mesh is made."""
    path = tmp_path / "Prüfling 2" / "case.toml"
    path.parent.mkdir()
    stated = {"specimen.mesh_size_um": 2.0, "specimen.fine_mesh_size_um": 1.5}
    write_case(default_case().with_values_at(stated), path)
    rows = "".join(f"{t},{t / 10},{t},{t / 1e6}\n" for t in range(4))
    (path.parent / "history.csv").write_text(f"time_s,stage_um,image,force_N\n{rows}")
    run(path, until="mesh")
    return path


def states(case: Path) -> dict[str, str]:
    return {stage.name: stage.state for stage in status_of(case).stages}


def test_what_is_done_outdated_damaged_or_was_cut_off_is_told(case: Path) -> None:
    later = dict.fromkeys(("measure", "identify", "diagnose", "advise", "report"), "missing")
    assert states(case) == {"mesh": "done"} | later
    results = case.parent / "results"
    (results / "measure.partial").mkdir()
    assert states(case)["measure"] == "unfinished"
    whole = (results / "mesh.vtu").read_bytes()
    (results / "mesh.vtu").write_bytes(b"")
    assert states(case)["mesh"] == "damaged"
    (results / "mesh.vtu").write_bytes(whole)
    case.write_text(case.read_text("utf-8").replace("length_um = 12.0", "length_um = 11.0"))
    (mesh, *_) = status_of(case).stages
    assert (mesh.state, mesh.why) == ("outdated", "[specimen] has changed")


def test_a_run_that_is_at_work_is_told_and_not_disturbed(case: Path) -> None:
    results = case.parent / "results"
    assert holder(results) == status_of(case).running == ""
    with sole_run(results):
        (results / "measure.partial").mkdir()
        found = status_of(case)
        assert found.running.startswith("process ")
        assert {s.name: s.state for s in found.stages}["measure"] == "running"
    assert holder(results) == ""


def test_the_answer_for_programs_has_the_verdict_of_the_case_as_it_is(case: Path) -> None:
    found = CliRunner().invoke(app, ["status", str(case.parent), "--json"])
    answer = json.loads(found.stdout)
    assert answer["stages"][0]["state"] == "done" and answer["stages"][0]["seconds"] > 0
    assert (answer["verdict"], answer["running"]) == ("", "")
    assert answer["results"] == str(case.parent / "results")


def test_results_elsewhere_are_made_and_found_there(case: Path, tmp_path: Path) -> None:
    there = tmp_path / "elsewhere" / "r"
    there.parent.mkdir()
    run(case, until="mesh", results=there)
    assert (there / "mesh.med").is_file()
    found = status_of(case, there)
    assert found.results == there and found.stages[0].state == "done"

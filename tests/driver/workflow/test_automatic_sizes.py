"""Meshes that are too coarse for a verdict are refined by a run, with the real solver."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from driver.case.model import Case
from driver.diagnosis.answer import result_types
from driver.results.mesh_sizes import refined, sized_case
from driver.virtual.truth import pull, stage_program
from driver.virtual.writing import record
from driver.workflow import refinement
from driver.workflow.pipeline import run
from tools.short_specimen import small_case, true_case, true_knots

CYCLES = ((4, 1), (4, 1))
LENGTH = 5.0  # µm


def short_case() -> Case:
    """A prism of a few cells, of whose law all but two constants are known."""
    return small_case().with_values_at(
        {
            "specimen.length_um": LENGTH,
            "specimen.boundary_point_um": (0.0, 0.44 * LENGTH, 0.0),
            "material.d": 1140.0,
            "solver.integration": "exponential",
            "loads.noise_uN": 1.0,
            "identification.parameters": ("tau0", "c"),
            "diagnosis.causes": ("grain_contrast",),
            "execution.processes": 1,
            "execution.budget_min": 30.0,
        }
    )


@pytest.mark.slow
def test_a_verdict_that_the_first_meshes_leave_open_is_found_on_finer_ones(
    tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any change of the error is too large on the first meshes, as if these were too coarse."""
    tolerated = result_types.GATE

    def finer(case: Case) -> Case:
        monkeypatch.setattr(result_types, "GATE", tolerated)
        return refined(case)

    monkeypatch.setattr(result_types, "GATE", 0.0)
    monkeypatch.setattr(refinement, "refined", finer)
    history = stage_program(CYCLES)
    small = {"specimen.cells": "hex20", "specimen.mesh_size_um": 0.5}
    truth = true_case(short_case()).with_values_at(small | {"solver.mean_dilatation": True})
    course = pull(truth, history, true_knots(history))
    automatic = short_case().with_values_at(
        {
            "specimen.cells": None,
            "specimen.mesh_size_um": "auto",
            "specimen.fine_mesh_size_um": "auto",
        }
    )
    path = record(tmp_path, automatic, course, 1)
    run(path, "diagnose", False)
    verdicts = [line.split()[1] for line in lines if line.startswith("verdict: ")]
    assert verdicts == ["numerics.", "nothing"]
    assert sum(line == "measure: started" for line in lines) == 1
    found = json.loads((tmp_path / "results" / "diagnosis.json").read_text("utf-8"))
    assert found["verdict"] == "nothing wrong" and found["numerics"]["passed"]
    assert found["meshes"]["refined"] == 1 == sized_case(path).specimen.refined
    assert found["meshes"]["cells"] == "hex20" and found["meshes"]["fine_mesh_size_um"] < 1.0
    tau0 = found["baseline"]["values"]["tau0"]
    assert abs(tau0["value"] - truth.material.tau0_MPa) < 3 * tau0["sigma"] < 3.0
    lines.clear()
    run(path, "diagnose", False)
    assert lines[-1] == "diagnose: done and unchanged"

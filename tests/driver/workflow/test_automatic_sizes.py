"""Meshes that are too coarse for a verdict are refined by a run, with the real solver."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from driver.case.model import Case
from driver.results.mesh_sizes import sized_case
from driver.virtual.truth import pull, stage_program
from driver.virtual.writing import record
from driver.workflow.pipeline import run
from tools.short_specimen import small_case, true_case, true_knots

CYCLES = ((4, 1), (4, 1))
LENGTH = 5.0  # µm


def short_case() -> Case:
    """A prism of a few cells, and loads so exact that they see the error of these."""
    return small_case().with_values_at(
        {
            "specimen.length_um": LENGTH,
            "specimen.boundary_point_um": (0.0, 0.44 * LENGTH, 0.0),
            "loads.noise_uN": 0.1,
            "identification.parameters": ("tau0", "c"),
            "diagnosis.causes": ("grain_contrast",),
            "execution.processes": 1,
            "execution.budget_min": 30.0,
        }
    )


@pytest.mark.slow
def test_a_verdict_that_the_first_meshes_leave_open_is_found_on_finer_ones(
    tmp_path: Path, lines: list[str]
) -> None:
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
    assert verdicts[0] == "numerics." and verdicts[-1] != "numerics."
    assert sum(line == "measure: started" for line in lines) == 1
    found = json.loads((tmp_path / "results" / "diagnosis.json").read_text("utf-8"))
    refined = len(verdicts) - 1
    assert found["meshes"]["refined"] == refined == sized_case(path).specimen.refined
    assert found["meshes"]["cells"] == "hex20" and found["meshes"]["fine_mesh_size_um"] < 1.0
    assert found["numerics"]["passed"]
    lines.clear()
    run(path, "diagnose", False)
    assert lines[-1] == "diagnose: done and unchanged"

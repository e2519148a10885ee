"""The results of one run in closed form, which the tests read with h5py, csv and json."""

from __future__ import annotations

from pathlib import Path

import pytest

from driver.case.model import load_case
from driver.forward import build
from driver.workflow import measure_stage, pipeline
from driver.workflow.engine import run_stages
from tools import closed_form


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run until the diagnosis, whose elongation is no line in stage travel."""
    folder = tmp_path_factory.mktemp("run")
    closed_form.write_files(folder, {"stretch_curvature": 0.1})
    path = folder / "case.toml"
    text = path.read_text("utf-8")
    asked = ('causes = "all"', 'causes = ["load_gain", "stretch_not_proportional"]')
    assert text.count(asked[0]) == 1
    path.write_text(text.replace(*asked), encoding="utf-8")
    solver = closed_form.ClosedFormSolver(0.001)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", lambda name, profile: solver)
        # Pictures take more time than all that is tested here.
        patch.setattr(measure_stage, "write_figures", lambda measured, workdir: None)
        case = load_case(path)
        run_stages(case, pipeline.stages(case), "diagnose")
    return folder / "results"

"""A whole small identification by Code_Aster itself, where run_aster is on PATH."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from driver.case.grains import Grain
from driver.case.history import HistoryTable
from driver.case.inference import Identification
from driver.case.loading import Boundary
from driver.case.material import MaterialTable
from driver.case.model import Case, load_case, write_case
from driver.case.solver import Execution, Solver
from driver.case.specimen import Specimen
from driver.experiment.history import read_history
from driver.forward.boundary_motion import knots_of_stage
from driver.forward.build import build_model, mesh_of
from driver.parameters.boundary import elongation_names
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CodeAsterAdapter().program() is None,
        reason="run_aster is not on PATH, so that nothing here meets the real program",
    ),
]
RATIO = 4.5e-4
TRUTH = {"tau0": 25.0}


def case(solver: str) -> Case:
    """One grain, one cycle, loads alone; one parameter of the law."""
    return Case(
        specimen=Specimen(length_um=6.0, mesh_size_um=5.0, fine_mesh_size_um=3.5),
        grains=(Grain(name="grain", euler_deg=(281.0, 8.0, 47.0)),),
        material=MaterialTable(strain_measure="small", tau0_MPa=30.0),
        history=HistoryTable(file="history.csv"),
        boundary=Boundary(motion="stage", stage_ratio=RATIO, stage_ratio_uncertainty=2e-5),
        identification=Identification(parameters=("tau0",), max_iterations=4),
        solver=Solver(
            name=solver,
            integration="backward_euler",
            gauss_points=5,
            steps_per_interval=2,
            fine_steps_per_interval=4,
        ),
        execution=Execution(processes=2),
    )


def write_history(folder: Path) -> None:
    """Loads that the bundled solver makes on a finer mesh by its exponential scheme, with noise."""
    stage = [0.0, 20.0, 40.0, 60.0, 45.0]
    rows = [f"{60.0 * k:g},{s:g},,0" for k, s in enumerate(stage)]
    path = folder / "history.csv"
    path.write_text("time_s,stage_um,image,force_N\n" + "\n".join(rows) + "\n")
    truth = case("bundled").model_copy(update={"solver": Solver()})
    history = read_history(path, with_images=False)
    model = build_model(truth, mesh_of(truth, 2.0), history, np.zeros((0, 2)), BundledAdapter(), 4)
    along, _ = knots_of_stage(history.stage[history.turning], RATIO, 0.0)
    knots = dict(zip(elongation_names(history.n_knots), along.tolist(), strict=True))
    load = model.predict(model.null_values() | TRUTH | knots).load
    noise = np.random.default_rng(4).normal(0.0, truth.loads.noise_uN, load.size)
    force = (load + noise) / truth.force_scale
    rows = [
        f"{60.0 * k:g},{s:g},,{f:.6f}" for k, (s, f) in enumerate(zip(stage, force, strict=True))
    ]
    path.write_text("time_s,stage_um,image,force_N\n" + "\n".join(rows) + "\n")


def test_both_solvers_identify_the_same_from_the_same_loads(
    tmp_path: Path, lines: list[str]
) -> None:
    write_history(tmp_path)
    found = {}
    for solver in ("bundled", "code_aster"):
        folder = tmp_path / solver
        folder.mkdir()
        shutil.copy(tmp_path / "history.csv", folder)
        write_case(case(solver), folder / "case.toml")
        lines.clear()
        pipeline.run(folder / "case.toml", "identify", False)
        results = read_hdf5(folder / "results" / "identify.h5")
        found[solver] = results["values"][-1], results["sigma"][-1], "\n".join(lines)
        assert load_case(folder / "case.toml").solver.name == solver
    (own, sigma, _), (other, theirs, log) = found["bundled"], found["code_aster"]
    assert abs(other - own) < 0.1 * sigma
    assert theirs == pytest.approx(sigma, rel=0.05)
    assert "time steps of first order" in log and "uncertain by about" not in log
    assert abs(other - TRUTH["tau0"]) < 3 * theirs

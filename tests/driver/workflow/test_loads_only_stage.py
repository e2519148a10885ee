"""A case without images, from its files to the report, with the solver in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from driver.case.model import CaseError, load_case
from driver.check import command as check_module
from driver.check.command import check
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.doubts.loads import stated_motion
from driver.experiment.reading import history_of, read_experiment
from driver.experiment.stack_checks import ExperimentError
from driver.export.command import ExportError, export_case
from driver.forward import build
from driver.identification.loads_alone import identify_from_loads
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import StageContext
from driver.workflow.loads_only_stage import SKIPPED, build_loads_problem
from solver_adapters.profile import Profile
from tools import closed_form
from tools.closed_form import KNOTS, LAW

TRUTH = {"tau0": 44.0}
RATIO, UNCERTAINTY = 4.5e-4, 1e-4


def solver(name: str, profile: Profile) -> closed_form.ClosedFormSolver:
    return closed_form.ClosedFormSolver(0.001)


def write(folder: Path) -> Path:
    """History with loads and no image, and a case without `[images]`."""
    closed_form.write_files(folder, TRUTH)
    for name in ("images.tif", "repeats.tif"):
        (folder / name).unlink()
    rows = [line.split(",") for line in (folder / "history.csv").read_text("utf-8").splitlines()]
    lines = [",".join(rows[0]), *(f"{t},{s},,{force}" for t, s, _, force in rows[1:])]
    (folder / "history.csv").write_text("\n".join(lines), encoding="utf-8")
    path = folder / "case.toml"
    text = path.read_text("utf-8")
    text = text[: text.index("[images]")] + text[text.index("[history]") :]
    stated = f"stage_ratio = {RATIO}\nstage_ratio_uncertainty = {UNCERTAINTY}\n"
    assert text.count('\nmotion = "images"') == 1
    text = text.replace('\nmotion = "images"', f'\nmotion = "stage"\n{stated}#')
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """The case file of a finished run, and its log."""
    path = write(tmp_path_factory.mktemp("loads"))
    lines: list[str] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", solver)
        with progress_to(lines.append):
            pipeline.run(path, None, False)
    return path, "\n".join(lines)


def test_a_run_without_images_goes_from_mesh_over_identify_to_report(
    finished: tuple[Path, str],
) -> None:
    path, log = finished
    assert SKIPPED in log
    started = [line.split(":")[0] for line in log.splitlines() if line.endswith(": started")]
    assert started == ["mesh", "identify", "report"]
    assert not (path.parent / "results" / "measure.h5").exists()


def test_law_and_elongation_are_found_within_their_uncertainty(
    finished: tuple[Path, str],
) -> None:
    path, _ = finished
    results = read_hdf5(path.parent / "results" / "identify.h5")
    with h5py.File(path.parent / "results" / "identify.h5", "r") as file:
        names = json.loads(file.attrs["names"])
        assert file.attrs["converged"]
    truth = {"tau0": 44.0, "c": 40e3, "d": 1500.0}
    truth |= {f"elongation_{k}": value for k, value in enumerate(KNOTS, start=1)}
    for name, value in truth.items():
        row = names.index(name)
        assert abs(results["values"][row] - value) < 3 * results["sigma"][row], name
    assert results["budget/load"] == pytest.approx(1.0, abs=0.3)
    # Loads fix each elastic unloading far better than the travel of the stage does.
    first, second = (names.index(f"elongation_{k}") for k in (1, 2))
    gap = np.zeros(len(names))
    gap[[first, second]] = 1.0, -1.0
    unloading = 0.01 * np.sqrt(gap @ results["covariance"] @ gap)  # θ is in units of 0.01 µm
    assert unloading < 0.2 * results["sigma"][second]


@pytest.mark.parametrize("wrong", [7, 10])
def test_a_wrong_load_that_the_case_leaves_out_moves_nothing(
    finished: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: int
) -> None:
    """Load 10 is that of a turning point, by which the start of the fit is chosen."""
    path = write(tmp_path)
    rows = (tmp_path / "history.csv").read_text("utf-8").splitlines()
    numbered = [row for row in range(1, len(rows)) if not rows[row].endswith(",")]
    time, stage, *_ = rows[numbered[wrong]].split(",")
    rows[numbered[wrong]] = f"{time},{stage},,5000"
    (tmp_path / "history.csv").write_text("\n".join(rows), encoding="utf-8")
    path.write_text(
        path.read_text("utf-8").replace("left_out = []", f"left_out = [{wrong}]"), "utf-8"
    )
    monkeypatch.setattr(build, "find_adapter", solver)
    pipeline.run(path, None, False)
    mine, whole = (
        read_hdf5(case.parent / "results" / "identify.h5") for case in (path, finished[0])
    )
    moved = (mine["values"] - whole["values"]) / whole["sigma"]
    assert np.abs(moved).max() < 0.3 and mine["budget/load"] == pytest.approx(1.0, abs=0.3)
    n_loads = len(whole["force"]) - 1
    page = (tmp_path / "results" / "report.html").read_text("utf-8")
    assert f"{n_loads} loads (number {wrong} left out) are" in page


def test_no_tilt_and_no_pose_is_sought(finished: tuple[Path, str]) -> None:
    path, _ = finished
    with h5py.File(path.parent / "results" / "identify.h5", "r") as file:
        names = json.loads(file.attrs["names"])
    assert set(names) == {
        *LAW, *(f"elongation_{k}" for k in range(1, 5)),
        "lambda_plus_Y", "lambda_plus_Z", "lambda_minus_Y", "lambda_minus_Z",
    }  # fmt: skip


def test_the_variance_of_what_the_loads_do_not_tell_is_that_of_its_prior(
    finished: tuple[Path, str],
) -> None:
    path, log = finished
    results = read_hdf5(path.parent / "results" / "identify.h5")
    with h5py.File(path.parent / "results" / "identify.h5", "r") as file:
        names = json.loads(file.attrs["names"])
    shares = dict(zip(names, results["prior_share"], strict=True))
    # Without tilt the amplitudes along Z move nothing.
    assert shares["lambda_plus_Z"] == pytest.approx(1.0)
    assert shares["tau0"] < 0.2
    width = dict(zip(names, results["prior/width"], strict=True))
    theta = np.sqrt(np.diag(results["covariance"]))[names.index("lambda_plus_Z")]
    assert theta == pytest.approx(width["lambda_plus_Z"])
    assert "λ⁺_Z: the data hardly see it; 100% of its variance" in log


def test_the_report_says_what_it_rests_on(finished: tuple[Path, str]) -> None:
    page = (finished[0].parent / "results" / "report.html").read_text("utf-8")
    assert "Identified from loads alone" in page and "(4.5 ± 1.0)·10⁻⁴" in page
    assert "<code>tau0</code>" in page and "<code>elongation_4</code>" in page
    assert "diagnosis are left out" in page
    assert "To be looked at:" in page and "Elongation knots" in page


def test_check_tells_that_no_images_are_used(
    finished: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(check_module, "find_adapter", solver)
    told = {finding.subject: finding for finding in check(finished[0])}
    assert told["images"].message.startswith("not used")
    assert "loads in 2 cycle(s)" in told["history"].message and "cost" in told


def test_what_needs_images_is_refused_in_a_sentence(finished: tuple[Path, str]) -> None:
    path, _ = finished
    with pytest.raises(ExportError, match='boundary.motion: found "stage", expected "images"'):
        export_case(path, path.parent / "export")
    with pytest.raises(ExperimentError, match="images.frames: found nothing"):
        read_experiment(load_case(path))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('\nmotion = "stage"\n', "\n",
         "boundary.stage_ratio: found 0.00045, expected nothing with"),
        (f"stage_ratio = {RATIO}\n", "", "boundary.stage_ratio: found nothing, expected a number"),
        (f"stage_ratio_uncertainty = {UNCERTAINTY}\n", "",
         "boundary.stage_ratio_uncertainty: found nothing, expected a number"),
        (f"stage_ratio = {RATIO}\n", "stage_ratio = -1\n",
         "boundary.stage_ratio: found -1, expected a number > 0"),
        ("jitter_nm = 0.0", "jitter_nm = 3.0",
         'boundary.jitter_nm: found 3, expected 0 with boundary.motion = "stage"'),
        ("starts = 1", "starts = 4",
         'identification.starts: found 4, expected 1 with boundary.motion = "stage"'),
        ('order = "joint"', 'order = "paper"',
         'identification.order: found "paper", expected "joint" with boundary.motion = "stage"'),
        ('prior = "gaussian"', 'prior = "none"',
         'identification.prior: found "none", expected "gaussian" or "tikhonov" with boundary'),
    ],
)  # fmt: skip
def test_what_does_not_fit_loads_alone_is_named(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = write(tmp_path)
    text = path.read_text("utf-8")
    assert text.count(old) == 1
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(CaseError) as error:
        load_case(path)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("ratio", "uncertainty", "expected"),
    [(2.0, 1e-4, "expected at most 30 %"), (RATIO, 1.0, "expected stage_ratio_uncertainty below")],
)
def test_check_warns_of_a_ratio_that_no_specimen_has(
    tmp_path: Path, ratio: float, uncertainty: float, expected: str
) -> None:
    path = write(tmp_path)
    case = load_case(path)
    stated = {"stage_ratio": ratio, "stage_ratio_uncertainty": uncertainty}
    boundary = case.boundary.model_copy(update=stated)
    finding = stated_motion(case.model_copy(update={"boundary": boundary}), history_of(case))
    assert finding.level == "warning" and expected in finding.message
    assert stated_motion(case, history_of(case)).level == "ok"


def test_loads_and_priors_that_leave_a_combination_open_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "find_adapter", solver)
    path = write(tmp_path)
    case, results = load_case(path), path.parent / "results"
    pipeline.run(path, "mesh", False)
    problem = build_loads_problem(StageContext(case, results, results), solver("", Profile()))
    held = {name: both for name, both in problem.objective.prior.items() if "lambda" not in name}
    open_ = replace(problem.objective, prior=held)
    with pytest.raises(InputError, match="lambda_plus_Z changes nothing that images and loads"):
        identify_from_loads(open_, problem.finer, problem.start, replace(problem.plan, most=3))

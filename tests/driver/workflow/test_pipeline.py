"""All stages before the report, on files, with the solver in closed form."""

from __future__ import annotations

import csv
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from driver.case.grains import Grain
from driver.case.model import Case, CaseError, load_case, schema
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.forward import build
from driver.parameters.boundary import LAMBDAS
from driver.parameters.registry import label_of
from driver.report.measured_figures import FIGURES
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from driver.workflow.engine import StageContext, StageError, run_stages, stage_keys
from meshes.files import read_med
from solver_adapters.interface import Capabilities, PreparedError, Progress, Response, Simulation
from solver_adapters.profile import Profile
from tests.driver.ebsd_files import FIRST, SECOND, grid, write_ctf
from tools import closed_form
from tools.closed_form import KNOTS

CURVATURE = 0.1


@dataclass
class Run:
    """A folder with a case, and what its stages said."""

    folder: Path
    lines: list[str] = field(default_factory=list)

    @property
    def path(self) -> Path:
        return self.folder / "case.toml"

    @property
    def results(self) -> Path:
        return self.folder / "results"

    def __call__(self, until: str = "diagnose") -> list[str]:
        """The stages that were run."""
        self.lines.clear()
        with progress_to(self.lines.append):
            run_stages(
                load_case(self.path),
                pipeline.stages(load_case(self.path)),
                until,
            )
        return [line.split(":")[0] for line in self.lines if line.endswith(": started")]

    def edit(self, old: str, new: str) -> None:
        text = self.path.read_text("utf-8")
        assert text.count(old) == 1, old
        self.path.write_text(text.replace(old, new), encoding="utf-8")


def solver(name: str, profile: Profile) -> closed_form.ClosedFormSolver:
    return closed_form.ClosedFormSolver(0.001)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A case of which mesh, measure, identify and diagnose have run."""
    run = Run(tmp_path_factory.mktemp("curved"))
    # A specimen whose elongation is not proportional to stage travel.
    closed_form.write_files(run.folder, {"stretch_curvature": CURVATURE, "tau0": 44.0})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", solver)
        assert run() == ["mesh", "measure", "identify", "diagnose"]
    return run


@pytest.fixture
def copied(finished: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """A copy of the finished case that a test may change."""
    monkeypatch.setattr(build, "find_adapter", solver)
    shutil.copytree(finished.folder, tmp_path / "case")
    return Run(tmp_path / "case")


class Elsewhere(closed_form.ClosedFormSolver):
    """A solver whose jobs are prepared only, and that keeps what it was asked for."""

    def __init__(self, profile: Profile, asked: list[tuple[Profile, Path | None]]) -> None:
        super().__init__(0.001)
        self.profile, self.asked = profile, asked

    def capabilities(self) -> Capabilities:
        return replace(super().capabilities(), in_process=False)

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        self.asked.append((self.profile, workspace))
        if self.profile.prepare_only and len(self.asked) > 1:
            raise PreparedError([Path("key")])
        return super().solve(simulation, workspace, progress)


def test_prepared_jobs_stop_the_run_and_a_later_run_goes_on(
    copied: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Profile, Path | None]] = []
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: Elsewhere(profile, asked))
    copied.edit('name = "bundled"', 'name = "elsewhere"')
    copied.edit("# [solver.profiles.code_aster]", "[solver.profiles.elsewhere]\nthreads = 3")
    with pytest.raises(PreparedError):
        pipeline.run(copied.path, None, False, prepare_only=True)
    assert len(asked) == 2 and asked[0] == asked[1]
    assert asked[0] == (Profile(threads=3, prepare_only=True), copied.results / "jobs")
    assert copied("identify") == ["identify"]
    assert asked[-1] == (Profile(threads=3), copied.results / "jobs")
    assert copied("identify") == []


def test_jobs_go_into_the_store_of_the_case_or_into_that_of_the_call_and_make_no_stage_stale(
    copied: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[Profile, Path | None]] = []
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: Elsewhere(profile, asked))
    copied.edit('# store = "../jobs"', 'store = "../jobs"')
    pipeline.run(copied.path, "identify", force=True)
    stores = {store for _, store in asked}
    assert stores == {copied.folder / "../jobs"}
    assert (copied.folder.parent / "jobs").is_dir()
    assert copied("identify") == []
    asked.clear()
    monkeypatch.chdir(copied.folder)
    pipeline.run(copied.path, "identify", force=True, store=Path("all/jobs"))
    assert {store for _, store in asked} == {copied.folder / "all" / "jobs"}
    assert copied("identify") == []


def test_a_store_that_cannot_be_made_is_refused_before_anything_is_computed(copied: Run) -> None:
    with pytest.raises(InputError, match="execution.store: found .*expected a folder"):
        pipeline.run(copied.path, force=True, store=copied.path)


def test_how_a_program_is_called_makes_no_stage_stale(copied: Run) -> None:
    copied.edit("# [solver.profiles.code_aster]", "[solver.profiles.bundled]\nthreads = 3")
    assert copied() == []


def test_the_bundled_solver_has_no_jobs_to_prepare(copied: Run) -> None:
    with pytest.raises(StageError, match='--prepare-only: found solver.name = "bundled"'):
        pipeline.run(copied.path, None, False, prepare_only=True)
    assert not (copied.results / "jobs").exists()


def test_both_meshes_are_written_for_solvers_and_for_eyes(finished: Run) -> None:
    working, fine = (read_med(finished.results / name) for name in ("mesh.med", "mesh_fine.med"))
    assert len(fine.cells) > len(working.cells) and working.n_grains == 2
    assert (finished.results / "mesh.vtu").is_file()
    assert (finished.results / "mesh_fine.vtu").is_file()


def test_the_elongation_is_measured(finished: Run) -> None:
    measured = read_hdf5(finished.results / "measure.h5")
    history = closed_form.history()
    at_knots = measured["elongation"][history.turning] - measured["elongation"][0]
    sigma = float(measured["elongation_sigma"])
    assert sigma < 4e-3
    np.testing.assert_allclose(at_knots, [0, *KNOTS], atol=4.5 * sigma)
    assert np.sqrt(np.mean(measured["chi"] ** 2)) == pytest.approx(1.0, abs=0.05)
    np.testing.assert_array_equal(measured["cycle"], history.cycle)
    with (finished.results / "measure.csv").open(encoding="utf-8", newline="") as file:
        written = [float(row["elongation_nm"]) for row in csv.DictReader(file)]
    np.testing.assert_allclose(written, 1e3 * measured["elongation"], rtol=1e-4)


def test_the_residual_over_its_noise_is_that_of_chi(finished: Run) -> None:
    measured = read_hdf5(finished.results / "measure.h5")
    over = measured["residual_over_noise"]
    np.testing.assert_allclose(np.sqrt(np.mean(over**2, axis=1)), measured["chi"], rtol=1e-5)
    # Interpolation keeps between 0.43² and all of the variance of an image's noise; the
    # reference adds its share.
    sigma = np.abs(measured["residual"] / over).ravel() / float(measured["sigma"])
    share = 1.0 / float(measured["n_reference"])
    assert 0.95 * np.sqrt(0.43**2 + share) < sigma.min()
    assert sigma.max() < np.sqrt(1.0 + share) + 1e-6


def test_the_mean_height_change_is_as_sure_as_the_mean_of_that_many_pixels(finished: Run) -> None:
    measured = read_hdf5(finished.results / "measure.h5")
    w = measured["motion"][..., 2]
    np.testing.assert_allclose(measured["mean_w"], w.mean(axis=1), atol=1e-12)
    pixels = measured["sigma"] * np.sqrt((1.0 + 1.0 / measured["n_reference"]) / w.shape[1])
    assert 1.0 <= float(measured["mean_w_sigma"] / pixels) < 1.2


def test_the_elements_of_both_meshes_fill_the_region_once(finished: Run) -> None:
    measured = read_hdf5(finished.results / "measure.h5")
    for name in ("uv", "w"):
        nodes, cells = measured[f"nodes_{name}"], measured[f"cells_{name}"]
        x, y = np.moveaxis(nodes[cells], -1, 0)
        areas = (x * np.roll(y, -1, 1) - y * np.roll(x, -1, 1)).sum(axis=1) / 2
        assert np.all(areas < 0) or np.all(areas > 0)
        assert abs(areas.sum()) == pytest.approx(np.prod(np.ptp(nodes, axis=0)))


def test_a_run_until_the_measurement_leaves_its_pictures(finished: Run) -> None:
    for name in FIGURES:
        assert (finished.results / name).read_bytes().startswith(b"\x89PNG")


def test_the_identification_is_written_with_its_uncertainty(finished: Run) -> None:
    found = read_hdf5(finished.results / "identify.h5")
    n = len(found["values"])
    assert found["covariance"].shape == (n, n) and np.linalg.eigvalsh(found["covariance"])[0] > 0
    np.testing.assert_allclose(np.diag(found["correlation"]), 1.0)
    assert float(found["budget/model"]) == pytest.approx(1.0, abs=0.1)
    assert float(found["budget/load"]) > 2  # the elongation is not proportional to stage travel
    assert found["prior/width"].shape == found["prior/mean"].shape == (n,)
    assert found["initial/load"].shape == found["final/load"].shape
    text = (finished.results / "identify.csv").read_text("utf-8").splitlines()
    assert text[0] == "parameter,value,sigma,unit,model" and len(text) == n + 1
    stages = json.loads((finished.results / "identify_history.json").read_text("utf-8"))
    assert list(stages) == ["A", "B", "C"]
    assert all("σ" in stage["reason"] and stage["seconds"] > 0 for stage in stages.values())


def test_the_identification_keeps_what_the_paper_shows(finished: Run) -> None:
    found = read_hdf5(finished.results / "identify.h5")
    names = [name.decode() for name in found["hessian_names"].tolist()]
    assert names == [*LAMBDAS, "tau0", "c", "d"]
    hessian = found["kinematic_hessian"]
    np.testing.assert_allclose(hessian, hessian.T)
    # Of the law the images of this bar may see a combination alone: null but for rounding.
    strength = np.linalg.eigvalsh(hessian)
    assert strength[0] > -1e-12 * strength[-1] and np.all(np.diag(hessian) > 0)
    for key in ("chi", "chi_f", "chi_F"):
        start, end = found[f"paper/{key}"]
        assert start > end > 0
        assert found[f"history/A/paper_{key}"][0] == start
        assert found[f"history/C/paper_{key}"][-1] == end
    last = found["values"][-1]
    assert any(found[f"history/C/{name}"][-1] == last for name in ("tau0", "c", "d"))
    assert "history/B/lambda_plus_Y" not in found
    assert np.all((found["prior_share"] >= 0) & (found["prior_share"] <= 1))


def test_boundary_noise_and_the_order_of_the_paper_go_through_to_the_diagnosis(
    copied: Run,
) -> None:
    copied.edit("jitter_nm = 0.0", "jitter_nm = 0.05")
    copied.edit('order = "joint"', 'order = "paper"')
    copied.edit("starts = 1", "starts = 2")
    copied.edit('causes = "all"', 'causes = ["load_gain"]')
    assert copied() == ["identify", "diagnose"]
    found = read_hdf5(copied.results / "identify.h5")
    assert found["jitter/load"].shape == (44, 44) and len(found["values"]) == 3
    assert len(found["starts/cost"]) == 2 and found["starts/tau0"][0] > 0
    record = json.loads((copied.results / "diagnosis.json").read_text("utf-8"))
    # What the identification held is free again: an error of a knot is none of the model.
    baseline = record["baseline"]["values"]
    assert {"tau0", "c", "d", "lambda_plus_Y", "elongation_1", "tilt_1"} <= set(baseline)


def test_a_parameter_that_nothing_sees_ends_the_run_in_one_sentence(copied: Run) -> None:
    """The closed form knows no second back stress while c2 is 0: d2 changes nothing."""
    copied.edit('parameters = ["tau0", "c", "d"]', 'parameters = ["tau0", "c", "d", "d2"]')
    copied.edit('prior = "gaussian"', 'prior = "none"')
    with pytest.raises(InputError, match="^identification: found that d2 changes nothing that"):
        copied("identify")
    copied.edit('prior = "none"', 'prior = "gaussian"')
    copied("identify")
    told = [line for line in copied.lines if "hardly see" in line]
    doubt = f"{label_of('d2')}: the data hardly see it; 100% of its variance is that of"
    assert any(doubt in line for line in told)


def test_the_cause_is_named_in_the_record(finished: Run) -> None:
    record = json.loads((finished.results / "diagnosis.json").read_text("utf-8"))
    assert record["verdict"] == "named" and record["causes"] == ["stretch_not_proportional"]
    added = record["added"]["stretch_curvature"]
    assert added["value"] == pytest.approx(CURVATURE, abs=4 * added["sigma"] + 0.005)
    gain = record["gain"]
    assert gain["share_of_excess_explained"] == pytest.approx(1.0, abs=0.2)
    assert gain["budget_before"]["load"] > 2 > gain["budget_after"]["load"]
    assert gain["held_out"]["chi_load_after"] < gain["held_out"]["chi_load_before"]
    assert set(gain["shift_in_sigma"]) == {"tau0", "c", "d"}
    scored = {cause["cause"]: cause for cause in record["steps"][0]["causes"]}
    assert scored["boundary_tilt"]["smallest_visible"] == [None, None]
    assert scored["stretch_not_proportional"]["refit"]["values"]["stretch_curvature"] > 0.05
    arrays = read_hdf5(finished.results / "diagnosis.h5")
    assert arrays["before/load"].shape == arrays["after/load"].shape == (44,)


def test_the_extended_case_stands_by_itself(copied: Run) -> None:
    extended = copied.results / "extended.toml"
    case = load_case(extended)
    assert case.extensions == {"stretch_curvature": pytest.approx(CURVATURE, abs=0.01)}
    assert case.images.frames is not None
    assert case.path(case.images.frames).is_file() and case.path(case.history.file).is_file()
    beside = json.loads((copied.results / "case.schema.json").read_text("utf-8"))
    assert extended.read_text("utf-8").startswith("#:schema ./case.schema.json")
    assert beside == schema()
    # It can be run: the cause is part of the model now, and nothing is wrong any more.
    again = copied.folder / "results" / "extended.toml"
    run_stages(load_case(again), pipeline.stages(case), "diagnose")
    record = json.loads((copied.results / "results" / "diagnosis.json").read_text("utf-8"))
    assert record["verdict"] == "nothing wrong"
    assert record["baseline"]["values"]["stretch_curvature"]["value"] == pytest.approx(
        CURVATURE, abs=0.01
    )


def test_a_changed_diagnosis_reruns_nothing_before_it(copied: Run) -> None:
    assert copied() == []
    copied.edit("refit = 2", "refit = 1")
    assert copied() == ["diagnose"]


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ('causes = "all"', 'causes = ["load_gain", "magic"]',
         'diagnosis.causes: found "magic", expected one of isotropic_hardening, latent_hard'),
        ('held_out_cycle = "last"', "held_out_cycle = 4",
         "diagnosis.held_out_cycle: found 4, expected one of the 2 cycle(s)"),
        ("left_out = []", f"left_out = {list(range(18, 44))}",
         "loads.left_out: found all loads of cycle 2, which is held out, expected some that it"),
    ],
)  # fmt: skip
def test_a_diagnosis_that_cannot_be_asked_for_is_one_sentence(
    copied: Run, old: str, new: str, sentence: str, lines: list[str]
) -> None:
    copied.edit(old, new)
    with pytest.raises(CaseError) as error:
        pipeline.run(copied.path, None, True)
    assert str(error.value).startswith(f"{copied.path}: {sentence}")
    assert not any("started" in line for line in lines)
    # What was found before is still there.
    assert (copied.results / "diagnosis.json").is_file()


def test_a_run_without_the_file_of_its_repeats_ends_before_anything_is_meshed(
    copied: Run, lines: list[str]
) -> None:
    (copied.folder / "repeats.tif").unlink()
    with pytest.raises(InputError, match="repeats.tif: images.repeats: found no"):
        pipeline.run(copied.path, None, True)
    assert not any("started" in line for line in lines)
    pipeline.run(copied.path, "mesh")


def test_what_is_odd_about_a_case_is_told_before_a_run_begins(
    copied: Run, lines: list[str]
) -> None:
    pipeline.run(copied.path, "mesh", force=True)
    assert not any(line.startswith("WARNING") for line in lines)
    lines.clear()
    section = f"macroscopic_mm2 = {load_case(copied.path).sections.macroscopic_mm2!r}"
    copied.edit(section, "macroscopic_mm2 = 1e-6")
    pipeline.run(copied.path, "mesh", force=True)
    (told,) = (number for number, line in enumerate(lines) if line.startswith("WARNING"))
    assert lines[told].startswith("WARNING: in figures: ")
    assert told < next(number for number, line in enumerate(lines) if "started" in line)


class Narrow(closed_form.ClosedFormSolver):
    """A solver that honours few parameters and small strain alone."""

    def capabilities(self) -> Capabilities:
        return replace(
            super().capabilities(),
            material=frozenset({"tau0", "c"}),
            strain_measures=frozenset({"small"}),
            cells=frozenset({10, 20}),
            mean_dilatation=True,
        )


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["tau0", "n", "K"]', ['"n"', '"K"']),
        ('parameters = ["tau0", "c", "d"]', 'parameters = ["tau0", "c"]', ['"finite"']),
        ("[extensions]", "[extensions]\nskin_tau0 = 1.1\nload_gain = 0.01", ['"d"', '"skin_tau0"']),
    ],
)
def test_what_the_solver_cannot_is_told_before_the_measurement(
    copied: Run,
    old: str,
    new: str,
    told: list[str],
    lines: list[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: Narrow(0.001))
    copied.edit(old, new)
    with pytest.raises(InputError) as refused:
        pipeline.run(copied.path, None, True)
    sentences = str(refused.value).splitlines()
    assert len(sentences) == len(told)
    assert all(f"found {name}, expected" in s for name, s in zip(told, sentences, strict=True))
    assert lines == []


def test_a_lost_result_of_an_earlier_stage_is_made_again(copied: Run) -> None:
    (copied.results / "measure.h5").unlink()
    assert copied("identify")[0] == "measure"


def test_the_stages_are_known_by_name(copied: Run) -> None:
    with pytest.raises(StageError, match='found "fit", expected one of mesh, measure, identify'):
        pipeline.run(copied.path, "fit", False)


def test_a_run_takes_the_case_and_its_threads_from_the_file(
    copied: Run, monkeypatch: pytest.MonkeyPatch, lines: list[str]
) -> None:
    threads: list[int] = []
    monkeypatch.setattr(pipeline, "use_threads", threads.append)
    copied.edit("threads = 1", "threads = 3")
    copied.edit("processes = 1", "processes = 2")
    pipeline.run(copied.path, "mesh", True)
    assert lines[1:3] == ["mesh: a minute at most", "mesh: started"] and threads == [6]
    assert lines[-1].startswith("mesh: finished in")


def test_a_run_refines_automatic_meshes_until_a_verdict_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stages in name only, but for the mesh; the third mesh is good enough for a verdict."""
    done: list[str] = []

    def in_name_only(name: str) -> Callable[[StageContext], None]:
        return lambda context: done.append(f"{name} {context.case.specimen.mesh_size:g}")

    def diagnose(context: StageContext) -> None:
        in_name_only("diagnose")(context)
        enough = context.case.specimen.refined == 2
        record = {
            "verdict": "nothing wrong" if enough else "numerics",
            "numerics": {"needed": None if enough else "mesh"},
        }
        (context.workdir / "diagnosis.json").write_text(json.dumps(record))

    for name in ("measure", "identify", "advise", "report"):
        monkeypatch.setattr(pipeline, f"run_{name}", in_name_only(name))
    monkeypatch.setattr(pipeline, "run_diagnose", diagnose)
    monkeypatch.setattr(build, "find_adapter", solver)
    closed_form.write_files(tmp_path, {})
    run = Run(tmp_path)
    run.edit("\nmesh_size_um = 1.2", '\nmesh_size_um = "auto"')
    run.edit("fine_mesh_size_um = 1.0", 'fine_mesh_size_um = "auto"')
    with progress_to(run.lines.append):
        pipeline.run(run.path)
    again = [f"{name} {size}" for size in ("0.533", "0.355") for name in ("identify", "diagnose")]
    first = ["measure 0.8", "identify 0.8", "diagnose 0.8"]
    assert done == [*first, *again, "advise 0.355", "report 0.355"]
    assert run.lines[3].startswith("tet10 of 0.8 and 0.556 µm, chosen by prismid; where the mesh")
    refined = [line for line in run.lines if "is refined: " in line]
    assert len(refined) == 2 and "0.533 and 0.371 µm" in refined[0]
    # A second run, and the report alone, are of the sizes of the first.
    done.clear()
    pipeline.run(run.path)
    assert done == []
    pipeline.report(run.path)
    assert done == ["report 0.355"]


# Which tables of the case each stage depends on, and with it all stages after it.
FIRST_STAGE = {
    "specimen": "mesh", "images": "measure", "history": "measure", "sections": "measure",
    "loads": "measure", "dic": "measure", "grains": "identify", "orientation": "identify",
    "material": "identify", "boundary": "identify", "solver": "identify",
    "identification": "identify", "extensions": "identify", "diagnosis": "diagnose",
}  # fmt: skip
CHANGES: dict[str, dict[str, object]] = {
    "specimen": {"length_um": 4.1}, "images": {"noise_nm": 8.0}, "history": {"file": "h.csv"},
    "sections": {"macroscopic_mm2": 2.9}, "loads": {"noise_uN": 5.0}, "dic": {"element_px": 11},
    "orientation": {"ebsd_to_specimen": ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))},
    "material": {"tau0_MPa": 41.0}, "boundary": {"U_X": "free"}, "solver": {"name": "other"},
    "identification": {"max_iterations": 7}, "diagnosis": {"refit": 1},
    "execution": {"processes": 7},
}  # fmt: skip


def keys(case: Case) -> dict[str, str]:
    return stage_keys(pipeline.stages(case), case)


def stale(before: Case, after: Case) -> list[str]:
    old, new = keys(before), keys(after)
    return [name for name in old if old[name] != new[name]]


def test_sizes_of_the_meshes_make_no_measurement_stale_that_does_not_use_them() -> None:
    case = closed_form.small_case()
    traced = case.with_values_at({"dic.mesh": "trace"})
    beyond = ["identify", "diagnose", "advise", "report"]
    for key, size, of_trace in (("mesh_size_um", 1.3, ["measure"]), ("fine_mesh_size_um", 0.5, [])):
        sizes = {f"specimen.{key}": size}
        assert stale(case, case.with_values_at(sizes)) == ["mesh", *beyond]
        assert stale(traced, traced.with_values_at(sizes)) == ["mesh", *of_trace, *beyond]


@pytest.mark.parametrize("table", Case.model_fields)
def test_a_stage_and_those_after_it_depend_on_its_tables_and_no_others(table: str) -> None:
    case = closed_form.small_case()
    if table == "grains":
        grain = case.grains[0].model_copy(update={"euler_deg": (1.0, 2.0, 3.0)})
        changed = case.model_copy(update={"grains": (grain, case.grains[1])})
    elif table == "extensions":
        changed = case.model_copy(update={"extensions": {"load_gain": 0.01}})
    else:
        update = getattr(case, table).model_copy(update=CHANGES[table])
        changed = case.model_copy(update={table: update})
    before, after = keys(case), keys(changed)
    names = list(before)
    assert names == ["mesh", "measure", "identify", "diagnose", "advise", "report"]
    stale = [name for name in names if before[name] != after[name]]
    first = FIRST_STAGE.get(table)  # how the machine is used changes no result
    assert stale == (names[names.index(first) :] if first else [])


def test_a_changed_map_makes_what_hangs_on_orientations_stale(tmp_path: Path) -> None:
    x, y = grid(3, 3)
    grains = (
        Grain(name="a", ebsd=str(tmp_path / "a.ctf"), ebsd_point_um=(0.0, 0.0)),
        closed_form.small_case().grains[1],
    )
    case = closed_form.small_case().model_copy(update={"grains": grains})
    loads_alone = case.with_values_at({"boundary.motion": "stage"})
    write_ctf(tmp_path / "a.ctf", x, y, FIRST)
    before, alone = keys(case), keys(loads_alone)
    write_ctf(tmp_path / "a.ctf", x, y, SECOND)
    after = keys(case)
    stale = [name for name in before if before[name] != after[name]]
    assert stale == ["identify", "diagnose", "advise", "report"]
    after = keys(loads_alone)
    assert [name for name in alone if alone[name] != after[name]] == ["identify", "report"]

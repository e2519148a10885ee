import hashlib
import json
import os
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from driver.case.consent import ConsentError, agree
from driver.case.model import Case, CaseError, default_case, load_case, write_case
from driver.common.errors import InputError
from driver.common.progress import progress_to
from driver.results.files import AbsentError, kept_folder, link_requests
from driver.results.kept_responses import keeping
from driver.results.stage_record import Done, read_record
from driver.workflow.engine import (
    Stage,
    StageContext,
    StageError,
    changed_inputs,
    finished,
    measured_files,
    run_stages,
    stage_inputs,
    stage_key,
)
from driver.workflow.run_lock import BusyError
from solver_adapters.interface import Simulation, SolverError
from tools import closed_form


class Workshop:
    """Two stages, the second built on the first, that count how often they are run."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.case_path = folder, folder / "case.toml"
        self.runs: list[str] = []
        self.lines: list[str] = []
        write_case(default_case(), self.case_path)
        for name in ("images.tif", "flats.tif", "repeats.tif", "history.csv"):
            (folder / name).write_text(name)
        self.stages = [
            Stage("mesh", "1", ("specimen",), self.mesh),
            Stage("measure", "1", ("images", "dic"), self.measure, measured_files),
        ]

    def mesh(self, context: StageContext) -> None:
        self.runs.append("mesh")
        (context.workdir / "mesh.txt").write_text(str(context.case.specimen.length))

    def measure(self, context: StageContext) -> None:
        self.runs.append("measure")
        (context.workdir / "maps").mkdir()
        (context.workdir / "maps" / "motion.txt").write_text(
            context.result("mesh.txt").read_text() + " motion"
        )

    def run(self, **options: Any) -> list[str]:
        """The stages that did run."""
        self.runs.clear()
        with progress_to(self.lines.append):
            run_stages(load_case(self.case_path), self.stages, **options)
        return list(self.runs)

    def edit(self, old: str, new: str) -> None:
        text = self.case_path.read_text("utf-8")
        assert text.count(old) == 1
        self.case_path.write_text(text.replace(old, new), encoding="utf-8")


@pytest.fixture
def workshop(tmp_path: Path) -> Workshop:
    return Workshop(tmp_path)


def test_what_is_done_and_unchanged_is_not_done_again(workshop: Workshop) -> None:
    assert workshop.run() == ["mesh", "measure"]
    results = workshop.folder / "results"
    assert (results / "maps" / "motion.txt").read_text() == "12.0 motion"
    assert workshop.run() == []
    assert workshop.lines[-2:] == ["mesh: done and unchanged", "measure: done and unchanged"]


def test_a_change_reruns_the_stages_that_depend_on_it(workshop: Workshop) -> None:
    workshop.run()
    workshop.edit("element_px = 16", "element_px = 20")
    assert workshop.run() == ["measure"]
    (workshop.folder / "flats.tif").write_text("other flats")
    assert workshop.run() == ["measure"]
    workshop.edit("length_um = 12.0", "length_um = 10.0")
    assert workshop.run() == ["mesh", "measure"]
    workshop.edit("max_iterations = 12", "max_iterations = 3")
    assert workshop.run() == []


def test_comments_of_the_case_and_its_place_on_the_disk_do_not_matter(
    workshop: Workshop, tmp_path: Path
) -> None:
    workshop.run()
    workshop.edit("[dic]", "# a comment\n[dic]")
    assert workshop.run() == []
    workshop.case_path = workshop.folder.rename(tmp_path.with_name("moved")) / "case.toml"
    assert workshop.run() == []


def test_new_code_reruns_its_stage_and_those_after_it(workshop: Workshop) -> None:
    workshop.run()
    workshop.stages[0] = replace(workshop.stages[0], version="2")
    assert workshop.run() == ["mesh", "measure"]


def test_a_result_that_is_gone_is_made_again(workshop: Workshop) -> None:
    workshop.run()
    (workshop.folder / "results" / "mesh.txt").unlink()
    assert workshop.run() == ["mesh"]


def test_force_reruns_and_until_stops(workshop: Workshop) -> None:
    assert workshop.run(until="mesh") == ["mesh"]
    assert workshop.run() == ["measure"]
    assert workshop.run(until="mesh", force=True) == ["mesh"]
    assert workshop.run(force=True) == ["mesh", "measure"]
    with pytest.raises(StageError, match='--until: found "mash", expected one of mesh, measure'):
        workshop.run(until="mash")


def test_what_a_stage_has_simulated_before_it_failed_is_taken_up_once(workshop: Workshop) -> None:
    solver, simulation = closed_form.ClosedFormSolver(), closed_form.problem().model.simulation
    runs: list[Simulation] = []
    answer, last = solver.answer, 3

    def counted(asked: Simulation) -> Any:
        runs.append(asked)
        return answer(asked)

    solver.answer = counted  # type: ignore[assignment]

    def measure(context: StageContext) -> None:
        kept = keeping(solver, context.kept)
        for k in range(last):
            kept.solve(simulation(closed_form.problem().truth | {"tau0": 40.0 + k}))
        if last < 5:
            raise SolverError("stopped")
        (context.workdir / "loads.txt").write_text("done")

    workshop.stages[1] = replace(workshop.stages[1], run=measure)
    with pytest.raises(SolverError):
        workshop.run()
    folder = workshop.folder / "results" / kept_folder("measure")
    assert len(runs) == 3 and len(list(folder.iterdir())) == 3
    last = 5
    workshop.run()
    assert len(runs) == 5 and not folder.exists()
    told = "  3 simulations of an interrupted run are kept: those that come again are taken up"
    assert told in workshop.lines
    assert workshop.lines.count("    a simulation that was made before is taken up") == 3
    # By force everything is made, also what another run has left; and no link is followed.
    last = 2
    with pytest.raises(SolverError):
        workshop.run(force=True)
    last = 5
    workshop.run(force=True)
    assert len(runs) == 5 + 2 + 5
    elsewhere = workshop.folder / "elsewhere"
    elsewhere.mkdir()
    folder.symlink_to(elsewhere)
    (workshop.folder / "results" / "loads.txt").unlink()
    workshop.run()
    assert not folder.is_symlink() and not list(elsewhere.iterdir())


def test_a_second_run_leaves_what_the_first_is_at_work_on(workshop: Workshop) -> None:
    def measure(context: StageContext) -> None:
        (context.workdir / "half.txt").write_text("half")
        with pytest.raises(BusyError, match="another run, process .* is at work on it"):
            run_stages(load_case(workshop.case_path), workshop.stages)
        assert (context.workdir / "half.txt").is_file()

    workshop.stages[1] = replace(workshop.stages[1], run=measure)
    assert workshop.run() == ["mesh"]
    assert (workshop.folder / "results" / "half.txt").is_file()


def test_a_stage_that_fails_leaves_the_results_of_its_last_run(workshop: Workshop) -> None:
    workshop.run()

    def failing(context: StageContext) -> None:
        (context.workdir / "mesh.txt").write_text("half")
        raise RuntimeError("no convergence")

    good = workshop.stages[0]
    workshop.stages[0] = replace(good, version="2", run=failing)
    with pytest.raises(RuntimeError, match="no convergence"):
        workshop.run()
    assert (workshop.folder / "results" / "mesh.txt").read_text() == "12.0"
    workshop.stages[0] = good
    assert workshop.run() == []


def test_a_crash_while_results_are_replaced_makes_the_stage_count_as_not_done(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    workshop.run()
    workshop.edit("length_um = 12.0", "length_um = 10.0")
    move = __import__("os").replace

    def crash(source: Path, target: Path) -> None:
        if str(target).endswith("mesh.txt"):
            raise OSError("disk full")
        move(source, target)

    monkeypatch.setattr("driver.workflow.engine.os.replace", crash)
    with pytest.raises(OSError, match="disk full"):
        workshop.run()
    monkeypatch.undo()
    workshop.edit("length_um = 10.0", "length_um = 12.0")
    assert workshop.run() == ["mesh"]


def test_results_that_are_no_longer_made_go_and_those_of_others_are_kept(
    workshop: Workshop,
) -> None:
    workshop.run()

    def renamed(context: StageContext) -> None:
        (context.workdir / "prism.txt").write_text("a mesh")

    workshop.stages = [replace(workshop.stages[0], version="2", run=renamed)]
    workshop.run()
    results = workshop.folder / "results"
    assert not (results / "mesh.txt").exists() and (results / "maps" / "motion.txt").exists()
    record = json.loads((results / "stages.json").read_text())
    assert record["mesh"]["outputs"] == ["prism.txt"]


def test_a_result_that_is_damaged_is_made_anew_and_one_for_people_may_be_edited(
    workshop: Workshop,
) -> None:
    def mesh(context: StageContext) -> None:
        workshop.mesh(context)
        (context.workdir / "mesh.json").write_text("{}")

    workshop.stages[0] = replace(workshop.stages[0], run=mesh)
    workshop.run()
    results = workshop.folder / "results"
    (results / "maps" / "motion.txt").write_text("edited")
    assert workshop.run() == []
    (results / "mesh.json").write_text("")
    assert workshop.run() == ["mesh"]
    assert (results / "mesh.json").read_text() == "{}"


def with_table(workshop: Workshop) -> Path:
    """A result for people beside those of the first stage."""

    def mesh(context: StageContext) -> None:
        workshop.mesh(context)
        (context.workdir / "mesh.csv").write_text("x,y\n1,2\n")
        (context.workdir / "extended.toml").write_text("[specimen]\n")

    workshop.stages[0] = replace(workshop.stages[0], run=mesh)
    workshop.run()
    return workshop.folder / "results" / "mesh.csv"


@pytest.mark.parametrize("damage", [b"", bytes(10)])
def test_a_damaged_result_for_people_is_made_anew_and_not_kept(
    workshop: Workshop, damage: bytes
) -> None:
    table = with_table(workshop)
    table.write_bytes(damage)
    assert workshop.run() == ["mesh"] and table.read_text() == "x,y\n1,2\n"
    assert "mesh: mesh.csv is damaged: it is made anew" in workshop.lines
    assert not list(table.parent.glob("mesh.edited*"))
    assert workshop.run() == []


@pytest.mark.parametrize("content", ["x,y\n1,", "x,y\n1,2\n3,4\n"])
def test_a_result_for_people_that_is_not_as_it_was_written_is_made_anew_and_kept(
    workshop: Workshop, content: str
) -> None:
    table = with_table(workshop)
    table.write_text(content)
    assert workshop.run() == ["mesh"] and table.read_text() == "x,y\n1,2\n"
    told = "mesh: mesh.csv has changed since it was written: it is made anew"
    assert told in workshop.lines
    assert table.with_name("mesh.edited.csv").read_text() == content


def test_the_extended_case_may_be_edited_and_its_stage_stays_done(workshop: Workshop) -> None:
    extended = with_table(workshop).with_name("extended.toml")
    extended.write_text("[specimen]\nwidth_um = 3.0\n")
    assert workshop.run() == []
    extended.write_bytes(b"")
    assert workshop.run() == ["mesh"] and extended.read_text() == "[specimen]\n"


def test_results_of_another_case_are_refused_with_the_remedy(workshop: Workshop) -> None:
    workshop.run()
    before = (workshop.folder / "results" / "stages.json").read_bytes()
    first, workshop.case_path = workshop.case_path, workshop.folder / "other.toml"
    shutil.copy(first, workshop.case_path)
    told = r"found results of .*case.toml, expected its own for each case: `results = \"NAME\"`"
    with pytest.raises(InputError, match=told):
        workshop.run(force=True)
    assert (workshop.folder / "results" / "stages.json").read_bytes() == before
    workshop.edit('results = "results"', 'results = "others"')
    assert workshop.run() == ["mesh", "measure"]
    assert (workshop.folder / "others" / "mesh.txt").is_file()


def test_a_case_that_is_renamed_keeps_its_results(workshop: Workshop) -> None:
    workshop.run()
    workshop.case_path = workshop.case_path.rename(workshop.folder / "renamed.toml")
    assert workshop.run() == []


@pytest.mark.parametrize("name", ["../elsewhere", "/tmp/elsewhere", ".hidden", "a/b", ""])
def test_a_case_names_no_results_outside_its_folder(workshop: Workshop, name: str) -> None:
    workshop.edit('results = "results"', f'results = "{name}"')
    with pytest.raises(CaseError, match="execution.results: found"):
        workshop.run()


def test_what_was_edited_is_kept_under_another_name_when_its_stage_runs_again(
    workshop: Workshop,
) -> None:
    workshop.run()
    motion = workshop.folder / "results" / "maps" / "motion.txt"
    for edited in ("first", "second"):
        motion.write_text(edited)
        workshop.run(force=True)
        assert motion.read_text().endswith(" motion")
    assert motion.with_name("motion.edited.txt").read_text() == "first"
    assert motion.with_name("motion.edited1.txt").read_text() == "second"
    assert f"{motion} has changed since it was written: it is kept as motion.edited.txt" in (
        workshop.lines
    )
    workshop.run(force=True)
    assert len(list(motion.parent.iterdir())) == 3


def test_what_was_edited_is_kept_where_its_stage_makes_it_no_longer(workshop: Workshop) -> None:
    workshop.run()
    motion = workshop.folder / "results" / "maps" / "motion.txt"
    motion.write_text("edited")
    workshop.stages[1] = replace(workshop.stages[1], version="2", run=lambda context: None)
    workshop.run()
    assert not motion.exists() and motion.with_name("motion.edited.txt").read_text() == "edited"


def test_a_result_that_is_read_back_is_kept_as_it_was_changed_when_it_is_made_anew(
    workshop: Workshop,
) -> None:
    def mesh(context: StageContext) -> None:
        workshop.mesh(context)
        (context.workdir / "mesh.json").write_text("{}")

    workshop.stages[0] = replace(workshop.stages[0], run=mesh)
    workshop.run()
    result = workshop.folder / "results" / "mesh.json"
    result.write_text('{"mine": 1}')
    assert workshop.run() == ["mesh"] and result.read_text() == "{}"
    assert result.with_name("mesh.edited.json").read_text() == '{"mine": 1}'


def test_the_mesh_of_a_deck_may_be_edited_and_its_stage_stays_done(workshop: Workshop) -> None:
    def mesh(context: StageContext) -> None:
        workshop.mesh(context)
        (context.workdir / "decks").mkdir()
        (context.workdir / "decks" / "job.med").write_text("made")

    workshop.stages[0] = replace(workshop.stages[0], run=mesh)
    workshop.run()
    deck = workshop.folder / "results" / "decks" / "job.med"
    deck.write_text("mine")
    assert workshop.run() == []
    assert workshop.run(force=True, until="mesh") == ["mesh"] and deck.read_text() == "made"
    assert deck.with_name("job.edited.med").read_text() == "mine"


def test_results_that_link_to_nothing_are_told_as_such(workshop: Workshop) -> None:
    (workshop.folder / "results").symlink_to(workshop.folder / "not mounted")
    with pytest.raises(InputError, match="a link to .*not mounted, which is not there"):
        workshop.run()


def test_a_folder_in_the_place_of_a_result_is_refused_before_the_work(workshop: Workshop) -> None:
    workshop.run()
    result = workshop.folder / "results" / "mesh.txt"
    result.unlink()
    result.mkdir()
    with pytest.raises(StageError, match=r"mesh.txt: result: found a folder, expected a file"):
        workshop.run()
    assert workshop.runs == []


def test_results_that_cannot_be_written_are_refused_in_one_sentence(workshop: Workshop) -> None:
    (workshop.folder / "results").write_text("a file")
    with pytest.raises(InputError, match="results: folder: found “File exists”, expected a folder"):
        workshop.run()


def test_stages_that_are_done_for_the_case_as_it_is_are_known(workshop: Workshop) -> None:
    def done(*needed: str) -> frozenset[str]:
        case = load_case(workshop.case_path)
        return finished(case, workshop.stages, needed)

    assert done() == frozenset()
    workshop.run()
    assert done("mesh", "measure") == {"mesh", "measure"}
    workshop.edit("element_px = 16", "element_px = 20")
    assert done("mesh") == {"mesh"}
    told = r"stage measure: found results of another state \(\[dic\] has changed\), expected those"
    with pytest.raises(StageError, match=told):
        done("mesh", "measure")


def test_blas_has_one_thread_in_a_stage_whatever_the_user_has_set(workshop: Workshop) -> None:
    """Numbers would be those of the cores of a machine."""
    found: set[int] = set()

    def measure(context: StageContext) -> None:
        found.update(
            each["num_threads"] for each in threadpool_info() if each["user_api"] == "blas"
        )
        workshop.measure(context)

    workshop.stages[1] = replace(workshop.stages[1], run=measure)
    with threadpool_limits(2, "blas"):
        workshop.run()
    assert found == {1}


def test_what_has_changed_since_a_stage_has_run_is_told(workshop: Workshop) -> None:
    workshop.run()
    case = load_case(workshop.case_path)
    entry, measure = read_record(workshop.folder / "results")["measure"], workshop.stages[1]

    def changed(stage: Stage, entry: Done = entry) -> str:
        return changed_inputs(entry, stage, case)

    assert changed(measure) == "an earlier stage has changed"
    newer = replace(measure, version="99")
    assert changed(newer) == f"of version {measure.version} of this stage, which has 99"
    missing = replace(
        measure, files=lambda case: (*measured_files(case), workshop.folder / "gone.tif")
    )
    assert changed(missing) == "gone.tif is empty or not there"
    (workshop.folder / "there.tif").write_bytes(b"levels")
    there = replace(
        measure, files=lambda case: (*measured_files(case), workshop.folder / "there.tif")
    )
    assert changed(there) == "there.tif has changed"
    more: Done = {**entry, "inputs": {**entry["inputs"], "old.tif": "0"}}
    assert changed(measure, more) == "old.tif is read no more"
    without: Done = {
        "key": entry["key"], "outputs": [], "finished": entry["finished"], "seconds": 1.0
    }  # fmt: skip
    assert changed(measure, without) == "of another version of prismid"
    assert changed(measure, without | {"inputs": {}}) == "of another version of prismid"


def test_the_key_of_a_stage_does_not_depend_on_how_its_case_is_named(
    workshop: Workshop, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = workshop.folder / "images.tif"
    workshop.edit('frames = "images.tif"', f'frames = "{frames}"')
    monkeypatch.chdir(workshop.folder)
    measure = workshop.stages[1]
    names = (workshop.case_path, Path("case.toml"))
    assert len({stage_key(measure, load_case(name), "") for name in names}) == 1


def test_a_stage_that_reads_no_earlier_results_stays_done_when_these_change(
    workshop: Workshop,
) -> None:
    measure = replace(workshop.stages[1], run=lambda context: workshop.runs.append("measure"))
    third = Stage("identify", "1", (), lambda context: workshop.runs.append("identify"))
    workshop.stages = [workshop.stages[0], replace(measure, alone=True), third]
    assert workshop.run() == ["mesh", "measure", "identify"]
    workshop.edit("length_um = 12.0", "length_um = 10.0")
    assert workshop.run() == ["mesh", "identify"]
    workshop.edit("element_px = 16", "element_px = 20")
    assert workshop.run() == ["measure", "identify"]


def test_a_key_that_is_left_out_makes_nothing_stale(workshop: Workshop) -> None:
    workshop.stages[0] = replace(workshop.stages[0], left_out={"specimen": ("length_um",)})
    assert workshop.run() == ["mesh", "measure"]
    workshop.edit("length_um = 12.0", "length_um = 10.0")
    assert workshop.run() == []
    workshop.edit("width_um = 4.0", "width_um = 3.0")
    assert workshop.run() == ["mesh", "measure"]


@pytest.mark.parametrize("force", [False, True])
def test_stages_begin_anew_with_a_case_that_is_refined(workshop: Workshop, force: bool) -> None:
    """What the refined case leaves as it was is not run again, not even if it was forced."""
    asked: list[str] = []

    def refined(case: Case, done: str) -> Case | None:
        asked.append(f"{done} {case.specimen.length:g}")
        again = done == "identify" and case.specimen.length > 10
        return case.with_values_at({"specimen.length_um": 10.0}) if again else None

    measure = replace(workshop.stages[1], run=lambda context: workshop.runs.append("measure"))
    workshop.stages = [
        workshop.stages[0],
        replace(measure, alone=True),
        Stage("identify", "1", (), lambda context: workshop.runs.append("identify")),
        Stage("report", "1", ("loads",), lambda context: workshop.runs.append("report")),
    ]
    if force:
        workshop.run()
    ran = workshop.run(refined=refined, force=force)
    assert ran == ["mesh", "measure", "identify", "mesh", "identify", "report"]
    first, second = (["mesh", "measure", "identify"], ["mesh", "measure", "identify", "report"])
    assert asked == [*(f"{name} 12" for name in first), *(f"{name} 10" for name in second)]
    mesh = workshop.folder / "results" / "mesh.txt"
    assert mesh.read_text() == "10.0"


@pytest.mark.parametrize("back", [True, False])
def test_where_a_refined_case_cannot_be_simulated_the_stages_end_with_the_case_before(
    workshop: Workshop, back: bool
) -> None:
    """What the refined case has not come to is there as it was, and not run again."""
    limit = 10.0

    def identify(context: StageContext) -> None:
        workshop.runs.append(f"identify {context.case.specimen.length:g}")
        if context.case.specimen.length < limit:
            raise SolverError("no convergence")

    def refined(case: Case, done: str) -> Case | None:
        tried = workshop.runs.count("identify 9")
        finer = case.with_values_at({"specimen.length_um": 9.0})
        return finer if done == "identify" and not tried else None

    def coarser(case: Case, error: SolverError) -> Case | None:
        assert case.specimen.length < limit and str(error) == "no convergence"
        return case.with_values_at({"specimen.length_um": 12.0}) if back else None

    workshop.stages = [
        workshop.stages[0],
        Stage("identify", "1", (), identify),
        Stage("report", "1", ("loads",), lambda context: workshop.runs.append("report")),
    ]
    if not back:
        with pytest.raises(SolverError, match="no convergence"):
            workshop.run(refined=refined, coarser=coarser)
        return
    ran = workshop.run(refined=refined, coarser=coarser)
    assert ran == ["mesh", "identify 12", "mesh", "identify 9", "mesh", "report"]
    assert (workshop.folder / "results" / "mesh.txt").read_text() == "12.0"


@pytest.mark.parametrize("reads_on", [True, False])
def test_a_file_that_is_replaced_while_its_stage_reads_on_ends_the_run(
    workshop: Workshop, reads_on: bool
) -> None:
    frames = workshop.folder / "images.tif"

    def replaced(context: StageContext) -> None:
        before = frames.stat()
        frames.write_text("IMAGES.TIF")  # of the same size and time
        os.utime(frames, ns=(before.st_atime_ns, before.st_mtime_ns))
        workshop.measure(context)

    workshop.stages[1] = replace(workshop.stages[1], run=replaced, reads_on=reads_on)
    if reads_on:
        told = r"images.tif: file: found another content than as measure began, expected the same"
        with pytest.raises(StageError, match=told):
            workshop.run()
    else:
        assert workshop.run() == ["mesh", "measure"]
    assert ("measure" in read_record(workshop.folder / "results")) is not reads_on


def test_one_name_for_two_results_is_refused(workshop: Workshop) -> None:
    workshop.stages[1] = replace(workshop.stages[1], run=workshop.mesh)
    with pytest.raises(
        StageError, match=r"measure: found a result mesh.txt, which belongs to mesh"
    ):
        workshop.run()
    assert (workshop.folder / "results" / "mesh.txt").exists()


def test_a_result_that_no_stage_has_made_is_named(workshop: Workshop) -> None:
    workshop.stages = workshop.stages[1:]
    with pytest.raises(
        AbsentError, match="mesh.txt: found nothing, expected the result of an earl"
    ):
        workshop.run()


def test_a_bad_case_stops_before_anything_is_written(workshop: Workshop) -> None:
    workshop.edit("length_um = 12.0", "length_um = -1")
    with pytest.raises(CaseError, match="specimen.length_um"):
        workshop.run()
    assert not (workshop.folder / "results").exists()


@pytest.mark.parametrize("text", ["", "{", "[]", '{"mesh": 3}', '{"mesh": {"key": "k"}}'])
def test_a_damaged_record_is_no_record(tmp_path: Path, text: str) -> None:

    (tmp_path / "stages.json").write_text(text, encoding="utf-8")
    assert read_record(tmp_path) == {}


def test_a_dataset_is_known_by_the_content_of_its_file(workshop: Workshop) -> None:
    workshop.edit('frames = "images.tif"', 'frames = "images.h5:/frames"')
    (workshop.folder / "images.h5").write_text("heights")
    assert workshop.run() == ["mesh", "measure"] and workshop.run() == []
    (workshop.folder / "images.h5").write_text("other heights")
    assert workshop.run() == ["measure"]


def test_a_file_that_cannot_be_looked_up_is_left_to_the_stage_to_tell(workshop: Workshop) -> None:
    workshop.edit('frames = "images.tif"', f'frames = "{"a" * 300}"')
    assert workshop.run() == ["mesh", "measure"]


def test_a_record_from_elsewhere_renames_and_removes_nothing_outside(workshop: Workshop) -> None:
    workshop.run()
    theirs = workshop.folder / "theirs.txt"
    theirs.write_text("theirs")
    path = workshop.folder / "results" / "stages.json"
    whole = path.read_text("utf-8")
    for name in ("../theirs.txt", str(theirs)):
        for table, entry in (("outputs", [name]), ("digests", {name: "0" * 64})):
            record = json.loads(whole)
            record["mesh"][table] = entry
            path.write_text(json.dumps(record), encoding="utf-8")
            workshop.run(force=True)
            assert theirs.read_text() == "theirs"


@pytest.mark.parametrize("name", ["measure.partial", "maps", "jobs"])
def test_a_link_among_the_results_leads_nowhere(workshop: Workshop, name: str) -> None:
    workshop.run()
    theirs, link = workshop.folder / "theirs", workshop.folder / "results" / name
    theirs.mkdir()
    (theirs / "motion.txt").write_text("theirs")
    if link.exists():
        shutil.rmtree(link)
    link.symlink_to(theirs)
    try:
        workshop.run(force=True)
    except InputError as error:
        assert str(error).startswith(f"{link}: file or folder: found a link to {theirs}")
    assert [(path.name, path.read_text()) for path in theirs.iterdir()] == [
        ("motion.txt", "theirs")
    ]


def test_results_that_are_a_link_need_the_consent_of_the_user(
    workshop: Workshop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    scratch = workshop.folder / "scratch"
    scratch.mkdir()
    (workshop.folder / "results").symlink_to(scratch)
    with pytest.raises(ConsentError, match="found a link that you have not agreed to .*scratch"):
        workshop.run()
    assert not list(scratch.iterdir())
    agree(link_requests(workshop.folder / "results"))
    assert workshop.run() == ["mesh", "measure"]
    assert (scratch / "mesh.txt").is_file()


def test_keys_of_a_table_that_came_later_change_no_result_until_they_are_stated(
    workshop: Workshop,
) -> None:
    case = load_case(workshop.case_path)
    stage = Stage("measure", "1", ("history",), workshop.measure)
    before = {"file": "history.csv", "grip_distance_mm": 32.0}
    digest = hashlib.sha256(json.dumps(before, sort_keys=True).encode()).hexdigest()
    assert stage_inputs(stage, case)["[history]"] == digest
    for key, value in (("separator", ";"), ("empty", "NaN"), ("first_row", 3)):
        stated = case.with_values_at({f"history.{key}": value})
        assert stage_inputs(stage, stated)["[history]"] != digest

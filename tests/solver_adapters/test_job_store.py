"""What a folder of jobs holds, what of it is not as it was written, and what may be removed."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import pytest

from solver_adapters.interface import PreparedError, Progress
from solver_adapters.job_store import StoredJob, faults_of, remove, stored_jobs
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.folder import partial_mark
from solver_adapters.jobs.lock import sole_process
from solver_adapters.response_file import read_response
from tests.solver_adapters.bar import SIMULATION, bar, folders

KEY = 64 * "7"


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """The folder of a job that is done, alone in its store."""
    bar(asker="/cases/a/case.toml").solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    return tmp_path / key


def the_job(folder: Path) -> StoredJob:
    (found,) = (job for job in stored_jobs(folder.parent) if job.folder == folder)
    return found


def failed(jobs: Path, do: str) -> None:
    with pytest.raises(JobError):
        bar(do).solve(SIMULATION, jobs)


def prepared(jobs: Path) -> Path:
    with pytest.raises(PreparedError) as error:
        bar(prepare_only=True).solve(SIMULATION, jobs)
    return error.value.folders[0]


def partial(jobs: Path, mark: str, process: int) -> Path:
    folder = jobs / f"{KEY}{mark}{process}-1a2b3c4d"
    folder.mkdir()
    return folder


def dead_process() -> int:
    ended = subprocess.Popen(["true"])
    ended.wait()
    return ended.pid


def test_a_job_is_told_with_its_solver_its_size_and_who_asked_for_it(job: Path) -> None:
    found = the_job(job)
    assert (found.key, found.state, found.holder) == (job.name, "done", "")
    assert found.solver == f"bar: {bar().version()}" and found.asker == "/cases/a/case.toml"
    assert found.size == sum(path.stat().st_size for path in job.iterdir())
    bar(asker="/cases/b/case.toml").solve(SIMULATION, job.parent)
    assert the_job(job).asker == "/cases/a/case.toml"


def test_a_job_is_used_when_it_is_computed_and_when_its_response_is_taken(job: Path) -> None:
    for path in (*job.iterdir(), job):
        os.utime(path, (1e9, 1e9))
    assert the_job(job).used == 1e9
    bar().solve(SIMULATION, job.parent)
    assert the_job(job).used > 1e9


def test_the_job_that_was_used_last_comes_first(tmp_path: Path) -> None:
    first, second, third = (replace(SIMULATION, tolerance=t) for t in (1e-6, 1e-7, 1e-8))
    names: list[str] = []
    for asked in (first, second, third):
        bar().solve(asked, tmp_path)
        (name,) = set(folders(tmp_path)) - set(names)
        names.append(name)
    assert [job.key for job in stored_jobs(tmp_path)] == names[::-1]
    bar().solve(second, tmp_path)
    assert [job.key for job in stored_jobs(tmp_path)] == [names[1], names[2], names[0]]


@pytest.mark.parametrize(
    ("do", "state", "left_over"),
    [
        ("print('<did not converge>'); sys.exit(4)", "did not converge", False),
        ("import os; os.kill(os.getpid(), 9)", "killed", True),
        ("sys.exit(3)", "no result", True),
    ],
)
def test_each_end_of_a_job_is_a_state_and_a_left_over_where_no_run_takes_it(
    tmp_path: Path, do: str, state: str, left_over: bool
) -> None:
    failed(tmp_path, do)
    (job,) = stored_jobs(tmp_path)
    assert job.state == state and job.is_left_over is left_over and job.solver


def test_what_was_put_away_is_damaged_and_a_left_over(job: Path) -> None:
    job.rename(job.with_name(f"{job.name}.damaged-1"))
    (found,) = stored_jobs(job.parent)
    assert (found.state, found.key, found.is_left_over) == ("damaged", job.name, True)


def test_what_a_dead_process_left_is_unfinished_and_what_a_living_one_fills_is_running(
    tmp_path: Path,
) -> None:
    dead = partial(tmp_path, partial_mark(), dead_process())
    alive = partial(tmp_path, partial_mark(), os.getpid())
    other = partial(tmp_path, ".partial-node7-", 12)
    states = {job.folder: (job.state, job.is_left_over) for job in stored_jobs(tmp_path)}
    assert states == {
        dead: ("unfinished", True), alive: ("running", False), other: ("unfinished", True),
    }  # fmt: skip
    with sole_process(tmp_path / KEY, pytest.fail):
        assert {job.state for job in stored_jobs(tmp_path)} == {"running"}


def test_a_prepared_job_is_no_left_over_and_runs_once_it_has_begun(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    found = the_job(folder)
    assert (found.state, found.holder, found.is_left_over) == ("prepared", "", False)
    (folder / "stdout.txt").touch()
    assert the_job(folder).holder == "another machine"
    (folder / "exit_code.txt").write_text("0\n")
    assert the_job(folder).holder == ""


def test_a_folder_without_a_record_is_told_and_is_nobodys_to_remove(job: Path) -> None:
    (job / "job.json").unlink()
    found = the_job(job)
    assert (found.state, found.is_left_over) == ("no record", False)
    (told,) = faults_of(found)
    assert told.startswith(f"{job / 'job.json'}: found no record of a job")


def test_all_else_in_the_folder_is_left_out(job: Path) -> None:
    for name in ("mine", "lost+found", KEY[1:], f"{KEY}.odd", f"{KEY.upper()}A"):
        (job.parent / name).mkdir()
    (job.parent / KEY).touch()
    (job.parent / f"{KEY}.killed").symlink_to(job)
    assert [found.folder for found in stored_jobs(job.parent)] == [job]
    assert stored_jobs(job.parent / "nothing") == []


def _truncated(job: Path) -> None:
    whole = (job / "response.h5").read_bytes()
    (job / "response.h5").write_bytes(whole[: len(whole) // 2])


def _edited(job: Path) -> None:
    """Another force, in a file that HDF5 finds nothing wrong with."""
    with h5py.File(job / "response.h5", "r+") as file:
        file["force"][...] = 2 * file["force"][()]
    read_response(job / "response.h5")


def _edited_record(job: Path) -> None:
    record = json.loads((job / "job.json").read_text())
    (job / "job.json").write_text(json.dumps(record | {"solver": "bar 7.0"}))


def _edited_deck(job: Path) -> None:
    with (job / "bar.json").open("a") as file:
        file.write(" ")


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_truncated, ["response.h5: found a file of another content"]),
        (_edited, ["response.h5: found a file of another content"]),
        (lambda job: (job / "response.h5").unlink(), ["response.h5: No such file or directory"]),
        (_edited_record, ["job.json: found an edited record"]),
        (lambda job: (job / "force.json").write_text("[1, 2, 3]"),
         ["force.json: found a file of another content"]),
        (_edited_deck, ["bar.json: found a file of another content",
                        ": found a deck of another key"]),
        (lambda job: (job / "job.json").write_text("{"), ["job.json: found no record of a job"]),
        (lambda job: shutil.move(job / "stdout.txt", job / "log"), ["stdout.txt: No such file"]),
    ],
    ids=["truncated", "edited", "missing", "record", "result file", "deck", "no record", "log"],
)  # fmt: skip
def test_what_is_not_as_it_was_written_is_named(
    job: Path, spoil: Callable[[Path], object], words: list[str]
) -> None:
    assert list(faults_of(the_job(job))) == []
    spoil(job)
    found = list(faults_of(the_job(job)))
    assert len(found) == len(words)
    for told, expected in zip(found, words, strict=True):
        assert told.startswith(str(job)) and expected in told and "expected" in told


def test_files_that_were_added_and_another_provenance_are_no_fault(job: Path) -> None:
    (job / "notes.txt").write_text("mine")
    assert list(faults_of(the_job(job))) == []


def test_a_job_that_has_another_jobs_name_is_named(job: Path) -> None:
    other = job.rename(job.with_name(KEY))
    (told,) = faults_of(the_job(other))
    assert told.startswith(f'{other}/job.json: key: found "{job.name}", expected the name of its')


def test_of_a_job_of_an_earlier_version_the_response_is_read(job: Path) -> None:
    record = json.loads((job / "job.json").read_text())
    for entry in ("digests", "simulation", "asker", "checksum"):
        del record[entry]
    (job / "job.json").write_text(json.dumps(record))
    assert list(faults_of(the_job(job))) == []
    _truncated(job)
    (told,) = faults_of(the_job(job))
    assert told.startswith(f"{job / 'response.h5'}: found a truncated HDF5 file")
    # A run reads the result files again.
    bar().solve(SIMULATION, job.parent)
    assert list(faults_of(the_job(job))) == []


def test_a_record_of_a_later_version_can_be_read(job: Path) -> None:
    record = json.loads((job / "job.json").read_text())
    (job / "job.json").write_text(json.dumps(record | {"queue": "night"}))
    bar().solve(SIMULATION, job.parent)
    assert the_job(job).state == "done" and folders(job.parent) == [job.name]


def test_a_deck_that_was_prepared_is_compared_with_its_key_in_any_ends_of_lines(
    tmp_path: Path,
) -> None:
    folder = prepared(tmp_path)
    deck = (folder / "bar.py").read_bytes()
    for same in (deck.replace(b"# now", b"# then"), deck.replace(b"\n", b"\r\n")):
        (folder / "bar.py").write_bytes(same)
        assert list(faults_of(the_job(folder))) == []
    (folder / "bar.py").write_bytes(deck + b"pass\n")
    (told,) = faults_of(the_job(folder))
    assert told == f"{folder}: found a deck of another key, expected one of the key in this name"


def test_left_overs_and_running_jobs_have_no_faults(tmp_path: Path) -> None:
    failed(tmp_path, "sys.exit(3)")
    partial(tmp_path, partial_mark(), os.getpid())
    for job in stored_jobs(tmp_path):
        (job.folder / "stdout.txt").write_text("other")
        assert list(faults_of(job)) == []


def test_a_removed_job_is_gone_and_is_computed_when_it_is_asked_for(job: Path) -> None:
    assert remove(the_job(job)) == ""
    assert folders(job.parent) == []
    bar().solve(SIMULATION, job.parent)
    assert folders(job.parent) == [job.name]


def test_a_job_that_is_gone_already_is_removed(job: Path) -> None:
    found = the_job(job)
    shutil.rmtree(job)
    assert remove(found) == "" and folders(job.parent) == []


def test_a_job_that_somebody_has_by_now_is_not_removed(job: Path) -> None:
    found = the_job(job)
    with sole_process(job, pytest.fail):
        assert remove(found).startswith(f"process {os.getpid()} on ")
    assert job.is_dir()
    alive = partial(job.parent, partial_mark(), os.getpid())
    assert remove(the_job(alive)) == "a process of this machine" and alive.is_dir()


def test_a_removal_that_is_cut_off_leaves_no_half_of_a_job(
    job: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cut_off(folder: Path) -> None:
        (folder / "job.json").unlink()
        raise KeyboardInterrupt

    monkeypatch.setattr(shutil, "rmtree", cut_off)
    with pytest.raises(KeyboardInterrupt):
        remove(the_job(job))
    monkeypatch.undo()
    assert not job.exists()
    bar().solve(SIMULATION, job.parent)
    assert job.is_dir()


@pytest.fixture
def at_work(tmp_path: Path) -> Iterator[list[StoredJob]]:
    """What is told of a job while its program runs."""
    seen: list[StoredJob] = []

    def look(progress: Progress) -> None:
        seen.extend(stored_jobs(tmp_path))
        seen.extend(replace(job, holder=remove(job)) for job in stored_jobs(tmp_path))
        raise InterruptedError

    with pytest.raises(InterruptedError):
        bar("import time; time.sleep(60)", asker="/cases/a.toml").solve(SIMULATION, tmp_path, look)
    yield seen


def test_a_job_at_work_tells_who_runs_it_for_whom_and_is_not_removed(
    at_work: list[StoredJob],
) -> None:
    told, kept = at_work
    assert told.state == "running" and told.holder.startswith(f"process {os.getpid()} on ")
    assert told.asker == "/cases/a.toml" and told.solver.startswith("bar: ") and told.size > 0
    assert kept.holder == told.holder

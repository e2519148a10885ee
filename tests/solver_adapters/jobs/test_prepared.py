"""Jobs that are written for another machine, computed there and collected."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.interface import PreparedError, Response
from solver_adapters.jobs.errors import CommandMissingError, JobError
from solver_adapters.jobs.folder import Record, read_record
from solver_adapters.jobs.prepared import (
    PREPARED,
    exit_code,
    has_results,
    prepare,
    prepared_job,
)
from solver_adapters.jobs.status import Status
from solver_adapters.response_file import read_provenance
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.bar import FORCE, SIMULATION, BarAdapter, bar, folders


def prepared(jobs: Path, do: str = "") -> Path:
    with pytest.raises(PreparedError) as error:
        bar(do, prepare_only=True).solve(SIMULATION, jobs)
    (folder,) = error.value.folders
    return folder


def without_program(jobs: Path, do: str = "") -> Response:
    return bar(do, command=("/opt/no/tool",)).solve(SIMULATION, jobs)


def test_a_prepared_job_is_computed_elsewhere_and_collected(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    assert prepared(tmp_path) == folder and folders(tmp_path) == [folder.name]
    readme = (folder / "README.txt").read_text()
    assert " -S bar.py\n" in readme and f"\n   {folder}\n" in readme
    with pytest.raises(CommandMissingError, match="has no results yet"):
        without_program(tmp_path)
    # Another machine, and back.
    shutil.move(folder, tmp_path / "carried")
    subprocess.run(["sh", "run.sh"], cwd=tmp_path / "carried", check=True)
    record = json.loads((tmp_path / "carried" / "job.json").read_text())
    (tmp_path / "carried" / "job.json").write_text(json.dumps(record | {"solver": "bar 2.0"}))
    shutil.move(tmp_path / "carried", folder)
    for _ in range(2):
        np.testing.assert_allclose(without_program(tmp_path).force, FORCE, rtol=1e-9)
        (folder / "force.json").unlink(missing_ok=True)
    assert read_provenance(folder / "response.h5").solver == "bar 2.0"
    assert folders(tmp_path) == [folder.name]
    # With the program on this machine the results count all the same.
    bar().solve(SIMULATION, tmp_path)
    assert folders(tmp_path) == [folder.name]


def test_a_job_that_is_running_elsewhere_has_no_results_yet(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "stdout.txt").write_text("step 1")
    (folder / "force.json").write_text("[1, 2")
    with pytest.raises(CommandMissingError, match="has no results yet"):
        without_program(tmp_path)


def computed(jobs: Path, do: str = "") -> Path:
    """A prepared job that was computed, and not read yet."""
    folder = prepared(jobs, do)
    subprocess.run(["sh", "run.sh"], cwd=folder, check=True)
    return folder


def change_record(folder: Path, **changes: object) -> None:
    record = json.loads((folder / "job.json").read_text())
    (folder / "job.json").write_text(json.dumps(record | changes))


def _append(name: str) -> Callable[[Path], None]:
    def append(folder: Path) -> None:
        with (folder / name).open("a") as file:
            file.write("# changed\n")

    return append


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_append("bar.py"), "/bar.py: found a file that was changed (line 6 without its header)"),
        (lambda folder: (folder / "bar.json").unlink(), "/bar.json: No such file or directory"),
        (lambda folder: (folder / "key.txt").write_text("1234\n"), "found results of the job 1234"),
        (lambda folder: (folder / "exit_code.txt").write_text(""), "/exit_code.txt: found '', exp"),
        (lambda folder: (folder / "exit_code.txt").write_text("o\n"), "/exit_code.txt: found 'o'"),
        (lambda folder: (folder / "force.json").unlink(), "/force.json: found nothing"),
    ],
    ids=["deck", "no deck", "key", "empty exit code", "exit code", "no result"],
)
def test_results_that_are_not_those_of_a_prepared_job_are_refused(
    tmp_path: Path, spoil: Callable[[Path], object], words: str
) -> None:
    folder = computed(tmp_path)
    spoil(folder)
    with pytest.raises(JobError) as error:
        without_program(tmp_path)
    assert error.value.status is Status.NO_RESULT and words in str(error.value)
    assert f"copy all files back, or delete {folder.name} to have it prepared" in str(error.value)


def test_other_ends_of_lines_and_another_provenance_are_no_other_deck(tmp_path: Path) -> None:
    folder = computed(tmp_path)
    deck = (folder / "bar.py").read_bytes()
    (folder / "bar.py").write_bytes(deck.replace(b"# now", b"# then").replace(b"\n", b"\r\n"))
    np.testing.assert_allclose(without_program(tmp_path).force, FORCE, rtol=1e-9)


def test_files_of_a_queue_or_an_editor_do_not_make_a_prepared_job_computed(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    for name in ("slurm-1.out", "bar.py~", "key.txt"):
        (folder / name).write_text("x")
    with pytest.raises(CommandMissingError, match="has no results yet"):
        without_program(tmp_path)
    assert prepared(tmp_path) == folder


def test_results_count_where_the_script_was_not_used(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "force.json").write_text(json.dumps(FORCE.tolist()))
    np.testing.assert_allclose(without_program(tmp_path).force, FORCE, rtol=1e-9)


@pytest.mark.parametrize(
    ("key", "found", "expected"),
    [
        ("status", "banana", 'one of "done", "prepared"'),
        ("status", "killed", 'one of "done", "prepared"'),
        ("status", None, "a valid string"),
        ("files", 3, "a valid array"),
        ("files", "bar.py", "a valid array"),
        ("solver", None, "a valid string"),
        ("solver", ["bar"], "a valid string"),
        ("wall", "long", "a valid number"),
        ("key", "0" * 64, "the name of its folder"),
    ],
)
def test_a_record_with_a_wrong_value_is_told_in_one_sentence(
    tmp_path: Path, key: str, found: object, expected: str
) -> None:
    folder = computed(tmp_path)
    change_record(folder, **{key: found})
    with pytest.raises(ResultFileError) as error:
        without_program(tmp_path)
    said = f"{folder}/job.json: {key}: found {json.dumps(found)}, expected {expected}"
    assert str(error.value).startswith(said) and "\n" not in str(error.value)


def test_a_record_that_was_spoiled_is_told_and_its_folder_is_left_alone(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "force.json").write_text("[1, 2, 3]")
    (folder / "job.json").write_text('{"solver": "bar 2.0')
    with pytest.raises(ResultFileError, match=f"^{folder}/job.json: found no record of a job"):
        without_program(tmp_path)
    assert (folder / "force.json").is_file()


def test_a_failure_elsewhere_is_told_until_better_results_are_there(tmp_path: Path) -> None:
    folder = prepared(tmp_path, "sys.exit(9 if sys.stdin.read() else 0)")
    (folder / "exit_code.txt").write_text("137\n")
    (folder / "stdout.txt").write_text("<did not converge>\n")
    with pytest.raises(JobError) as error:
        without_program(tmp_path, "sys.exit(9 if sys.stdin.read() else 0)")
    assert error.value.status is Status.NOT_CONVERGED and error.value.place == str(folder)
    subprocess.run(["sh", "run.sh"], cwd=folder, check=True)
    found = without_program(tmp_path, "sys.exit(9 if sys.stdin.read() else 0)")
    np.testing.assert_allclose(found.force, FORCE, rtol=1e-9)


def test_results_that_are_there_are_used_where_jobs_are_only_prepared(tmp_path: Path) -> None:
    bar().solve(SIMULATION, tmp_path)
    bar(prepare_only=True).solve(SIMULATION, tmp_path)
    assert len(folders(tmp_path)) == 1


def test_the_script_runs_the_call_with_its_variables_and_keeps_its_exit_code(
    tmp_path: Path,
) -> None:
    call = ("sh", "-c", 'cat "my deck"; echo "$LEVEL" >&2; exit 3')
    record = Record("bar", "k1", "elsewhere", status=PREPARED, command=call, files=["my deck"])
    folder = prepare(tmp_path, record, {"my deck": b"a deck\n"}, {"LEVEL": "two words"})
    assert folder == tmp_path / "k1" and prepared_job(folder) == read_record(folder, {PREPARED})
    assert not has_results(folder, ("result",)) and not (folder / "exit_code.txt").exists()
    subprocess.run(["sh", str(folder / "run.sh")], check=True)
    assert has_results(folder, ("result",)) and exit_code(folder) == 3
    assert (folder / "stdout.txt").read_text() == "a deck\n"
    assert (folder / "stderr.txt").read_text() == "two words\n"


def test_a_folder_that_was_not_prepared_is_no_prepared_job(tmp_path: Path) -> None:
    assert prepared_job(tmp_path / "none") is None
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    assert prepared_job(tmp_path / key) is None


def test_results_are_lost_by_no_status_that_was_set_by_hand(tmp_path: Path) -> None:
    folder = computed(tmp_path)
    change_record(folder, status="done")
    np.testing.assert_allclose(without_program(tmp_path).force, FORCE, rtol=1e-9)
    assert (folder / "force.json").is_file() and (folder / "response.h5").is_file()


def test_a_job_prepared_again_has_the_limits_of_today_and_a_changed_deck_is_told(
    tmp_path: Path,
) -> None:
    def limited(seconds: int) -> BarAdapter:
        adapter = bar(prepare_only=True)
        adapter.deck = f"# prismid limits: begin\n# {seconds} s\n# prismid limits: end\n".encode()
        return adapter

    folders_told = []
    for seconds in (60, 900):
        with pytest.raises(PreparedError) as error:
            limited(seconds).solve(SIMULATION, tmp_path)
        folders_told.append(error.value.folders)
    assert folders_told[0] == folders_told[1]
    ((folder,), _) = folders_told
    assert "# 900 s" in (folder / "bar.py").read_text()
    # While it runs nothing is written below it.
    (folder / "stdout.txt").write_text("")
    with pytest.raises(PreparedError):
        limited(60).solve(SIMULATION, tmp_path)
    assert "# 900 s" in (folder / "bar.py").read_text()
    (folder / "stdout.txt").unlink()
    _append("bar.py")(folder)
    with pytest.raises(ResultFileError, match="found a file that was changed"):
        limited(60).solve(SIMULATION, tmp_path)


def test_a_job_prepared_again_with_another_call_has_it_in_its_script(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "run.sh").write_text("echo mine\n")
    assert prepared(tmp_path) == folder
    assert (folder / "run.sh").read_text() == "echo mine\n", "an edited script of the same call"
    with pytest.raises(PreparedError):
        bar(command=("/path/to/another", "-S"), prepare_only=True).solve(SIMULATION, tmp_path)
    for name in ("run.sh", "README.txt"):
        assert "/path/to/another -S bar.py" in (folder / name).read_text()
    record = prepared_job(folder)
    assert record is not None and record.command[0] == "/path/to/another"


def test_a_job_that_was_killed_elsewhere_is_told_as_killed(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "exit_code.txt").write_text("137\n")
    (folder / "stdout.txt").write_text("a bar\n")
    with pytest.raises(JobError) as error:
        without_program(tmp_path)
    assert error.value.status is Status.KILLED

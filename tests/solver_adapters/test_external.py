"""One simulation becomes one job: run once, judged by system and log, or prepared for elsewhere."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import socket
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters import external
from solver_adapters.external import ResultFileError, Status
from solver_adapters.interface import (
    Direction,
    NotRunError,
    PreparedError,
    Progress,
    Response,
    UnfinishedError,
    UnsupportedError,
)
from solver_adapters.jobs.errors import CommandMissingError, JobError
from solver_adapters.material import Material
from solver_adapters.response_file import (
    Provenance,
    read_provenance,
    read_response,
    write_response,
)
from solver_adapters.validation import BadSimulationError
from tests.solver_adapters.bar import BarAdapter, bar
from tests.solver_adapters.boxes import box, pulled

SIMULATION = replace(
    pulled(box(), Material(strain_measure="small"), (0.001, 0.002)), integration="backward_euler"
)
FORCE = 233.5e3 * np.array([0.0, 0.004, 0.008])  # C11 times the elongation of 4 µm


def folders(jobs: Path) -> list[str]:
    return sorted(path.name for path in jobs.iterdir())


def failed(jobs: Path, do: str, **settings: object) -> JobError:
    with pytest.raises(JobError) as error:
        bar(do, **settings).solve(SIMULATION, jobs)
    return error.value


def runs(jobs: Path) -> int:
    """How often the program got to its end, in all folders together."""
    return sum(len(path.read_text()) for path in jobs.glob("*/count"))


def test_a_job_is_run_once_and_then_read_from_its_folder(tmp_path: Path) -> None:
    first = bar().solve(SIMULATION, tmp_path)
    np.testing.assert_allclose(first.force, FORCE, rtol=1e-9)
    (key,) = folders(tmp_path)
    assert len(key) == 64
    (tmp_path / key / "count").unlink()
    again = bar().solve(SIMULATION, tmp_path)
    assert runs(tmp_path) == 0
    np.testing.assert_array_equal(again.force, first.force)
    record = json.loads((tmp_path / key / "job.json").read_text())
    assert record["status"] == "done" and record["key"] == key and record["memory"] > 0
    provenance = read_provenance(tmp_path / key / "response.h5")
    assert (provenance.adapter, provenance.key) == ("bar", key)
    assert provenance.solver == bar().version() == record["solver"]


def test_without_a_workspace_nothing_is_left() -> None:
    np.testing.assert_allclose(bar().solve(SIMULATION).force, FORCE, rtol=1e-9)
    with pytest.raises(JobError) as error:
        bar("print('<did not converge>')").solve(SIMULATION)
    assert "its files are in" not in str(error.value) and "its log ends:" in str(error.value)


def test_a_provenance_header_changes_no_key_and_anything_else_does(tmp_path: Path) -> None:
    later, other = bar(), bar("pass")
    later.deck = b"# prismid provenance: begin\n# later\n# prismid provenance: end\n"
    for adapter in (bar(), later):
        adapter.solve(SIMULATION, tmp_path)
    assert len(folders(tmp_path)) == 1
    other.solve(SIMULATION, tmp_path)
    bar(command=("python3", "-S", "-E")).solve(SIMULATION, tmp_path)
    bar().solve(replace(SIMULATION, tolerance=1e-8), tmp_path)
    assert len(folders(tmp_path)) == 4
    bar(memory=3000.0, wall_time=60.0).solve(SIMULATION, tmp_path)
    assert len(folders(tmp_path)) == 4


@pytest.mark.parametrize("status", [Status.NOT_CONVERGED, Status.BAD_DECK])
def test_an_end_that_a_repetition_would_repeat_is_kept(tmp_path: Path, status: Status) -> None:
    do = f"print('step 7\\n<{status}>')\nsys.exit(4)"
    first = failed(tmp_path, do)
    assert first.status is status
    assert f"bar: {status} (exit code 4); " in str(first)
    assert str(first).endswith(f"\n  | step 7\n  | <{status}>")
    again = failed(tmp_path, do)
    assert str(again) == str(first) and runs(tmp_path) == 1
    assert (Path(again.place) / "stdout.txt").is_file()


@pytest.mark.parametrize(
    ("do", "settings", "status", "words"),
    [
        ("import time; time.sleep(60)", {"wall_time": 0.5}, Status.OUT_OF_TIME, "wall-clock time"),
        ("while True: pass", {"cpu_time": 0.5}, Status.OUT_OF_TIME, "CPU time 0.5 s"),
        ("b = bytearray(300_000_000); import time; time.sleep(60)", {"memory": 200.0},
         Status.OUT_OF_MEMORY, "the limit is 200 MB"),
        ("print('<out of memory>')", {}, Status.OUT_OF_MEMORY, "raise memory_MB"),
        ("import os; os.kill(os.getpid(), 9)", {}, Status.KILLED, "ended from outside"),
        ("import os; os.remove('force.json')", {}, Status.NO_RESULT, "expected the forces"),
        ("sys.exit(3)", {}, Status.NO_RESULT, "exit code 3"),
        ("import os; os.abort()", {}, Status.NO_RESULT, "exit code -6"),
        ("open('force.json', 'w').write('[1, 2]')", {}, Status.NO_RESULT,
         "displacement of shape (2, "),
        ("open('force.json', 'w').write('[1, 2, NaN]')", {}, Status.NO_RESULT, "not finite"),
    ],
)  # fmt: skip
def test_an_end_by_circumstances_is_told_and_never_kept(
    tmp_path: Path, do: str, settings: dict[str, object], status: Status, words: str
) -> None:
    for _ in range(2):
        error = failed(tmp_path, do, **settings)
        assert error.status is status and words in str(error)
        assert "a bar of 233500" in error.tail
    (folder,) = folders(tmp_path)
    assert folder.endswith("." + status.replace(" ", "-"))
    assert (tmp_path / folder / "stdout.txt").is_file()


def test_a_tiny_limit_of_memory_is_told_in_digits(tmp_path: Path) -> None:
    error = failed(tmp_path, "import time; time.sleep(60)", memory=1e-3)
    assert " MB, the limit is 0.001 MB" in str(error) and "(0 MB" not in str(error)


def _empty(stored: Path) -> None:
    stored.write_bytes(b"")


def _of_another_job(stored: Path) -> None:
    origin = read_provenance(stored)
    write_response(stored, read_response(stored), replace(origin, key="0" * 64))


def _of_another_motion(stored: Path) -> None:
    response = read_response(stored)
    moved = replace(response, displacement=1.001 * response.displacement)
    write_response(stored, moved, read_provenance(stored))


@pytest.mark.parametrize("damage", [_empty, _of_another_job, _of_another_motion, Path.unlink])
def test_a_response_that_is_damaged_or_foreign_is_read_again_from_its_result_files(
    tmp_path: Path, damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    bar().solve(SIMULATION, tmp_path)
    (stored,) = tmp_path.glob("*/response.h5")
    (stored.parent / "notes.txt").write_text("mine")
    damage(stored)
    for _ in range(2):
        np.testing.assert_allclose(bar().solve(SIMULATION, tmp_path).force, FORCE, rtol=1e-9)
    assert runs(tmp_path) == 1 and len(folders(tmp_path)) == 1
    assert (stored.parent / "notes.txt").read_text() == "mine"
    (message,) = caplog.messages
    assert message.endswith("its result files were read again")


@pytest.mark.parametrize("damaged", ["force.json", "bar.json"])
def test_a_job_beyond_repair_is_kept_under_another_name_and_made_anew(
    tmp_path: Path, damaged: str, caplog: pytest.LogCaptureFixture
) -> None:
    for count in (1, 2):
        bar().solve(SIMULATION, tmp_path)
        key = folders(tmp_path)[0]
        _empty(tmp_path / key / "response.h5")
        (tmp_path / key / damaged).unlink()
        (tmp_path / key / "notes.txt").write_text("mine")
        np.testing.assert_allclose(bar().solve(SIMULATION, tmp_path).force, FORCE, rtol=1e-9)
        kept = tmp_path / f"{key}.damaged-{count}"
        assert (kept / "notes.txt").read_text() == "mine"
        assert str(kept) in caplog.messages[-1] and damaged in caplog.messages[-1]


def test_results_are_lost_by_no_status_that_was_set_by_hand(tmp_path: Path) -> None:
    folder = computed(tmp_path)
    change_record(folder, status="done")
    np.testing.assert_allclose(without_program(tmp_path).force, FORCE, rtol=1e-9)
    assert (folder / "force.json").is_file() and (folder / "response.h5").is_file()


def test_what_a_dead_process_left_is_cleared_and_a_living_one_is_left_alone(
    tmp_path: Path,
) -> None:
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    shutil.rmtree(tmp_path / key)
    ended = subprocess.Popen(["true"])
    ended.wait()
    dead, alive = (
        tmp_path / f"{other}.partial-{socket.gethostname()}-{pid}-x"
        for other, pid in (("of another job", ended.pid), (key, os.getpid()))
    )
    dead.mkdir()
    alive.mkdir()
    bar().solve(SIMULATION, tmp_path)
    assert not dead.exists() and alive.is_dir()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"material": Material(a1=0.1, strain_measure="small")},
         "a1 = 0.1: the solver bar cannot honour it; .* that can: bundled"),
        ({"material": Material(strain_measure="small", interaction=((1.0,) * 24,) * 24)},
         "interaction = given: .*bundled"),
        ({"material": Material()}, 'strain_measure = "finite": .*bundled'),
        ({"directions": (Direction("tau0", material={"tau0": 1.0}),)},
         "derivatives along tau0: .*bundled"),
    ],
)  # fmt: skip
def test_what_it_cannot_honour_is_refused_by_name_before_anything_runs(
    tmp_path: Path, change: dict[str, object], words: str
) -> None:
    with pytest.raises(UnsupportedError, match=words):
        bar().solve(replace(SIMULATION, **change), tmp_path)  # type: ignore[arg-type]
    assert folders(tmp_path) == []


def test_a_term_that_it_has_is_not_refused(tmp_path: Path) -> None:
    bar().solve(replace(SIMULATION, material=Material(Q=5.0, b=2.0, strain_measure="small")))


def test_a_broken_simulation_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadSimulationError):
        bar().solve(replace(SIMULATION, times=SIMULATION.times[::-1]), tmp_path)


def test_an_absent_program_is_told_with_what_to_put_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PRISMID_CONFIG", "/home/me/mine.toml")
    adapter = BarAdapter()
    assert adapter.version() == "absent"
    with pytest.raises(CommandMissingError) as error:
        adapter.solve(SIMULATION, tmp_path)
    assert isinstance(error.value, NotRunError)
    assert str(error.value) == (
        'bar: command missing (found no "prismid-bar-that-nobody-has" on PATH); install it, or '
        'state the call as command = ["/path/to/prismid-bar-that-nobody-has"] under '
        "[solver.profiles.bar] in the case or under [profiles.bar] in /home/me/mine.toml, or let "
        "`prismid run --prepare-only` write the jobs for another machine"
    )
    with pytest.raises(CommandMissingError, match='found no "/opt/no/tool"\\)'):
        bar(command=("/opt/no/tool",)).solve(SIMULATION, tmp_path)


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
    assert " -S bar.py\n" in readme and f"results/jobs/{folder.name}" in readme
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


def test_a_job_of_this_machine_is_never_a_prepared_one(tmp_path: Path) -> None:
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    change_record(tmp_path / key, status="prepared")
    with pytest.raises(ResultFileError, match='status: found "prepared", expected one of "bad d'):
        bar().solve(SIMULATION, tmp_path)
    assert runs(tmp_path) == 1


def test_a_long_word_of_the_call_is_no_file(tmp_path: Path) -> None:
    script = "exec " + sys.executable + " -S bar.py " + 300 * " "
    asked = bar(command=("sh", "-c", script)).solve(SIMULATION, tmp_path)
    np.testing.assert_allclose(asked.force, FORCE, rtol=1e-9)


def test_a_record_that_was_spoiled_is_told_and_its_folder_is_left_alone(tmp_path: Path) -> None:
    folder = prepared(tmp_path)
    (folder / "force.json").write_text("[1, 2, 3]")
    (folder / "job.json").write_text('{"solver": "bar 2.0')
    with pytest.raises(ResultFileError, match=f"^{folder}/job.json: found no record of a job"):
        without_program(tmp_path)
    assert (folder / "force.json").is_file()


def test_whoever_hears_of_the_progress_can_end_the_job(tmp_path: Path) -> None:
    def stop(progress: Progress) -> None:
        assert (progress.time, progress.end) == (0.0, 2.0)
        raise InterruptedError

    with pytest.raises(InterruptedError):
        bar("import time; time.sleep(60)").solve(SIMULATION, tmp_path, stop)
    assert folders(tmp_path) == []


def test_what_was_computed_is_kept_where_its_response_cannot_be_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, response: Response, origin: Provenance) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(external, "write_response", full)
    with pytest.raises(OSError, match="No space left"):
        bar().solve(SIMULATION, tmp_path)
    (folder,) = folders(tmp_path)
    assert folder.endswith(".no-result") and (tmp_path / folder / "force.json").is_file()


def test_the_same_job_at_the_same_time_leaves_one_folder(tmp_path: Path) -> None:
    do = "import time; time.sleep(0.5)"
    with ThreadPoolExecutor(3) as pool:
        answers = [pool.submit(bar(do).solve, SIMULATION, tmp_path) for _ in range(3)]
    for answer in answers:
        np.testing.assert_allclose(answer.result().force, FORCE, rtol=1e-9)
    assert len(folders(tmp_path)) == 1


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


@pytest.mark.parametrize(
    "error",
    [
        JobError("bar", Status.NOT_CONVERGED, "exit code 1", "the end", "/there"),
        CommandMissingError("bar", Status.COMMAND_MISSING, remedy="install it"),
        PreparedError([Path("/a"), Path("/b")]),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_are_sent_between_processes(error: Exception) -> None:
    copy = pickle.loads(pickle.dumps(error))
    assert type(copy) is type(error) and str(copy) == str(error) and copy.args == error.args


def test_an_unfinished_run_is_sent_with_what_it_reached(tmp_path: Path) -> None:
    error = UnfinishedError("at 3 s", bar().solve(SIMULATION), 1)
    copy = pickle.loads(pickle.dumps(error))
    assert str(copy) == "at 3 s" and copy.reached == 1 and len(copy.response.force) == 3

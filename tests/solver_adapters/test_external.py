"""One simulation becomes one job: run once, judged by system and log, or prepared for elsewhere."""

from __future__ import annotations

import json
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from solver_adapters import external
from solver_adapters.external import ResultFileError, Status
from solver_adapters.interface import (
    BadSimulationError,
    Direction,
    NotRunError,
    PreparedError,
    Progress,
    Response,
    Simulation,
    UnfinishedError,
    UnsupportedError,
)
from solver_adapters.jobs.errors import CommandMissingError, JobError
from solver_adapters.jobs.folder import partial_mark
from solver_adapters.material import Material
from solver_adapters.response_file import (
    Provenance,
    read_provenance,
    read_response,
    write_response,
)
from tests.solver_adapters.bar import FORCE, SIMULATION, BarAdapter, bar, folders


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
    assert "its files are in" not in str(error.value) and "its log says:" in str(error.value)


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


def test_an_end_that_says_something_of_the_parameters_is_kept(tmp_path: Path) -> None:
    status = Status.NOT_CONVERGED
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
        ("import os; os.abort()", {}, Status.CRASHED, "exit code -6"),
        ("import os; os.kill(os.getpid(), 11)", {}, Status.CRASHED, "exit code -11"),
        ("sys.exit(139)", {}, Status.CRASHED, "the fault is in the program"),
        ("print('x: error while loading shared libraries: y.so'); sys.exit(127)", {},
         Status.BROKEN, "mend it"),
        ("print('<bad deck>'); sys.exit(1)", {}, Status.BAD_DECK, "see its log"),
        ("print('<out of disk>'); sys.exit(1)", {}, Status.OUT_OF_DISK, "free space"),
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
        assert "a bar of 233500" in error.quote
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


def _edited(stored: Path) -> None:
    with h5py.File(stored, "r+") as file:
        file["force"][...] = 2 * file["force"][()]
    read_response(stored)  # nothing is wrong with it but the numbers


@pytest.mark.parametrize(
    "damage", [_empty, _of_another_job, _of_another_motion, _edited, Path.unlink]
)
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


def test_result_files_that_were_edited_are_no_result(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    _empty(tmp_path / key / "response.h5")
    (tmp_path / key / "force.json").write_text("[0, 1, 2]")
    np.testing.assert_allclose(bar().solve(SIMULATION, tmp_path).force, FORCE, rtol=1e-9)
    assert folders(tmp_path) == [key, f"{key}.damaged-1"]
    assert "force.json: found a file of another content" in caplog.messages[-1]


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


def test_what_a_dead_process_left_is_cleared_and_a_living_one_is_left_alone(
    tmp_path: Path,
) -> None:
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    shutil.rmtree(tmp_path / key)
    ended = subprocess.Popen(["true"])
    ended.wait()
    dead, alive = (
        tmp_path / f"{name}{partial_mark()}{pid}-x"
        for name, pid in (("of another job", ended.pid), (key, os.getpid()))
    )
    other = tmp_path / f"{key}.partial-node7-{ended.pid}-x"
    for folder in (dead, alive, other):
        folder.mkdir()
    bar().solve(SIMULATION, tmp_path)
    assert not dead.exists() and alive.is_dir() and other.is_dir()


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
    tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    with pytest.raises(UnsupportedError, match=words):
        bar().solve(replace(SIMULATION, **change), tmp_path)
    assert folders(tmp_path) == []


class _NoHardening(BarAdapter):
    def check_supported(self, simulation: Simulation) -> None:
        if simulation.material.Q > 5:
            raise UnsupportedError("Q is too much")


def test_what_an_adapter_judges_is_refused_before_its_files_are_written(tmp_path: Path) -> None:
    weak, strong = (
        replace(SIMULATION, material=Material(Q=Q, strain_measure="small")) for Q in (4.0, 6.0)
    )
    adapter = _NoHardening()
    assert adapter.files(weak) == adapter.write(weak)
    with pytest.raises(UnsupportedError, match="Q is too much"):
        adapter.files(strong)
    with pytest.raises(UnsupportedError, match="Q is too much"):
        adapter.solve(strong, tmp_path)
    with pytest.raises(BadSimulationError):
        adapter.files(replace(SIMULATION, times=SIMULATION.times[::-1]))
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


def change_record(folder: Path, **changes: object) -> None:
    record = json.loads((folder / "job.json").read_text())
    (folder / "job.json").write_text(json.dumps(record | changes))


def test_a_job_of_this_machine_is_never_a_prepared_one(tmp_path: Path) -> None:
    bar().solve(SIMULATION, tmp_path)
    (key,) = folders(tmp_path)
    change_record(tmp_path / key, status="prepared")
    with pytest.raises(ResultFileError, match='status: found "prepared", expected one of "did n'):
        bar().solve(SIMULATION, tmp_path)
    assert runs(tmp_path) == 1


def test_a_long_word_of_the_call_is_no_file(tmp_path: Path) -> None:
    script = "exec " + sys.executable + " -S bar.py " + 300 * " "
    asked = bar(command=("sh", "-c", script)).solve(SIMULATION, tmp_path)
    np.testing.assert_allclose(asked.force, FORCE, rtol=1e-9)


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


def test_the_same_job_at_the_same_time_is_run_once(tmp_path: Path) -> None:
    do = "import time; time.sleep(0.5)"
    with ThreadPoolExecutor(3) as pool:
        answers = [pool.submit(bar(do).solve, SIMULATION, tmp_path) for _ in range(3)]
    for answer in answers:
        np.testing.assert_allclose(answer.result().force, FORCE, rtol=1e-9)
    assert len(folders(tmp_path)) == 1 and runs(tmp_path) == 1


def test_a_job_that_failed_in_one_process_is_run_by_the_one_that_has_waited(
    tmp_path: Path,
) -> None:
    do = "import time; time.sleep(0.5); open('../runs', 'a').write('x'); sys.exit(3)"
    with ThreadPoolExecutor(2) as pool:
        answers = [pool.submit(bar(do).solve, SIMULATION, tmp_path) for _ in range(2)]
    assert all(isinstance(answer.exception(), JobError) for answer in answers)
    assert (tmp_path / "runs").read_text() == "xx"


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

"""A job is one process's at a time, and nobody waits for a dead one."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from solver_adapters.jobs import lock
from solver_adapters.jobs.lock import at_rest, holder_of, sole_process

ROOT = Path(__file__).parents[3]
# A process that has a job until a line is written to it, on a machine of a stated name.
HOLD = """
import socket, sys
from pathlib import Path

if sys.argv[2]:
    socket.gethostname = lambda: sys.argv[2]
from solver_adapters.jobs import lock

lock.LEASE = float(sys.argv[3])
folder = Path(sys.argv[1])
with lock.sole_process(folder, lambda holder: None):
    print("held", flush=True)
    sys.stdin.readline()
    (folder.parent / "worked").touch()
"""


@contextmanager
def held(folder: Path, machine: str = "", lease: float = 1.0) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", HOLD, str(folder), machine, str(lease)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT
    ) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        yield other
        other.kill()


class _Stopped(Exception):
    pass


def stop(holder: str) -> None:
    raise _Stopped(holder)


def nobody(holder: str) -> None:
    raise AssertionError(f"waited for {holder}")


def test_a_job_that_another_process_has_is_waited_for(tmp_path: Path) -> None:
    waited: list[str] = []

    def let_go(holder: str) -> None:
        if not waited:
            assert other.stdin is not None
            other.stdin.write("\n")
            other.stdin.flush()
        waited.append(holder)

    with held(tmp_path / "key") as other:
        with sole_process(tmp_path / "key", let_go):
            assert (tmp_path / "worked").exists()
        assert waited[0].startswith(f"process {other.pid} on ")
    assert [path.name for path in tmp_path.iterdir()] == ["worked"]


def test_who_waits_can_be_stopped_and_another_job_is_free(tmp_path: Path) -> None:
    with held(tmp_path / "key") as other:
        with pytest.raises(_Stopped, match=str(other.pid)), sole_process(tmp_path / "key", stop):
            pass
        assert str(other.pid) in holder_of(tmp_path / "key")
        with sole_process(tmp_path / "another", nobody):
            assert holder_of(tmp_path / "another")


def test_a_process_of_this_machine_that_was_killed_keeps_nobody_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Longer than any test: the time of the lease plays no part.
    monkeypatch.setattr(lock, "LEASE", 1e6)
    with held(tmp_path / "key", lease=1e6) as other:
        other.kill()
        other.wait()
        assert (tmp_path / "key.lock").exists() and holder_of(tmp_path / "key") == ""
        with at_rest(tmp_path / "key") as ours:
            assert ours
        with sole_process(tmp_path / "key", nobody):
            pass


def test_a_living_process_of_another_machine_keeps_others_away_beyond_its_lease(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "LEASE", 1.0)
    changes: set[int] = set()

    def let_go_after_six_touches(holder: str) -> None:
        assert holder == f"process {other.pid} on node7"
        changes.add((tmp_path / "key.lock").stat().st_mtime_ns)
        if len(changes) > 6:  # of a third of a lease each
            assert other.stdin is not None
            other.stdin.write("\n")
            other.stdin.close()
            changes.clear()

    with (
        held(tmp_path / "key", "node7") as other,
        sole_process(tmp_path / "key", let_go_after_six_touches),
    ):
        assert (tmp_path / "worked").exists()


def test_a_dead_process_of_another_machine_is_waited_for_no_longer_than_its_lease(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "LEASE", 1.0)
    waited: list[str] = []
    with held(tmp_path / "key", "node7") as other:
        other.kill()
        other.wait()
        assert holder_of(tmp_path / "key") == f"process {other.pid} on node7"
        with at_rest(tmp_path / "key") as ours:
            assert not ours
        with sole_process(tmp_path / "key", waited.append):
            assert not (tmp_path / "worked").exists()
    assert waited and set(waited) == {f"process {other.pid} on node7"}


def test_a_lock_that_was_cut_off_as_it_was_written_is_passed_over(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "LEASE", 0.2)
    (tmp_path / "key.lock").touch()
    waited: list[str] = []
    with sole_process(tmp_path / "key", waited.append):
        pass
    assert set(waited) == {"another process"} and not (tmp_path / "key.lock").exists()


def test_who_has_lost_a_job_leaves_the_lock_of_the_next_one(tmp_path: Path) -> None:
    with sole_process(tmp_path / "key", nobody):
        (tmp_path / "key.lock").unlink()
        with held(tmp_path / "key") as other:
            with pytest.raises(_Stopped), sole_process(tmp_path / "key", stop):
                pass
            assert other.poll() is None
            assert str(other.pid) in holder_of(tmp_path / "key")


def test_a_lock_that_nobody_has_touched_for_an_hour_is_no_holder_at_a_look(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with held(tmp_path / "key", "node7") as other:
        other.kill()
        other.wait()
        monkeypatch.setattr(lock, "SILENT", -1.0)
        assert holder_of(tmp_path / "key") == ""
        with at_rest(tmp_path / "key") as ours:
            assert ours
    assert not (tmp_path / "key.lock").exists()


def test_a_clock_that_is_ahead_of_that_of_the_files_frees_no_job(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time()
    monkeypatch.setattr(time, "time", lambda: now + 1e6)
    with held(tmp_path / "key", "node7"), at_rest(tmp_path / "key") as ours:
        assert holder_of(tmp_path / "key") == "" and not ours

"""Calls of the real command line in processes of their own."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import psutil
import pytest

from driver.batch import calls
from driver.batch.calls import Outcome, carry_out, carry_out_on_worker
from driver.batch.jobs import Job
from solver_adapters.kernels import PACKAGES
from tests.driver.batch.cases import job, write_small_case

SETTINGS = "[program]\ncycles = [[30, 1]]\nlargest_strain = 0.01\n[truth]\ntau0 = 25.0\n"


@pytest.fixture
def token(tmp_path: Path) -> Path:
    made = tmp_path / "running"
    made.touch()
    return made


def long_job(folder: Path) -> Job:
    """A truth that takes a minute."""
    case = write_small_case(folder / "base")
    settings = folder / "settings.toml"
    settings.write_text(SETTINGS)
    call = ("virtual", str(case), "--to", str(folder / "made"), "--settings", str(settings))
    return job(folder, "a", call)


def test_calls_are_made_one_after_the_other_and_logged(tmp_path: Path, token: Path) -> None:
    one, two = (("init", str(tmp_path / name)) for name in ("one", "two"))
    made = job(tmp_path, "a", one, two)
    outcome = carry_out(made, 1, token)
    assert (outcome.status, outcome.why) == ("done", "") and outcome.seconds > 0
    lines = made.log.read_text("utf-8").splitlines()
    assert [line.partition(" written")[0] for line in lines] == [
        str(tmp_path / name / "case.toml") for name in ("one", "two")
    ]


def test_a_call_that_fails_is_told_in_its_own_words_and_ends_the_job(
    tmp_path: Path, token: Path
) -> None:
    gone = tmp_path / "gone.toml"
    made = job(tmp_path, "a", ("run", str(gone)), ("init", str(tmp_path / "never")))
    outcome = carry_out(made, 1, token)
    assert outcome.status == "failed" and not (tmp_path / "never").exists()
    assert outcome.why == (
        f"{gone}: file: found nothing, expected a case file (`prismid init DIR` writes one)"
    )


def test_nothing_is_executed_that_lies_in_the_folder_of_the_call(
    tmp_path: Path, token: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "signal.py").write_text("raise SystemExit('executed')\n")
    monkeypatch.chdir(tmp_path)
    outcome = carry_out(job(tmp_path, "a", ("init", str(tmp_path / "one"))), 1, token)
    assert outcome.status == "done"


def test_a_process_that_the_system_ends_is_told_with_what_helps(
    tmp_path: Path, token: Path
) -> None:
    found = at_work(long_job(tmp_path), token, lambda child: child.kill())
    assert found[0] == "failed" and found[1].startswith("ended by the system with SIGKILL, most")


def test_a_job_waits_for_processes_of_it_that_are_still_about_to_end(
    tmp_path: Path, token: Path
) -> None:
    made = job(tmp_path, "a", ("init", str(tmp_path / "one")))
    made.lock.parent.mkdir()
    with made.lock.open("wb") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        thread = threading.Thread(target=carry_out, args=(made, 1, token))
        thread.start()
        time.sleep(1.0)
        assert not made.log.exists()
        fcntl.flock(held, fcntl.LOCK_UN)
        thread.join(timeout=30.0)
    assert (tmp_path / "one" / "case.toml").is_file()


def test_a_job_stops_where_its_token_is_gone(tmp_path: Path, token: Path) -> None:
    found = at_work(long_job(tmp_path), token, lambda child: token.unlink())
    assert found == ("stopped", "")
    assert not (tmp_path / "made" / "case.toml").exists()
    later = job(tmp_path, "a", ("init", str(tmp_path / "never")))
    assert carry_out(later, 1, token).status == "stopped" and not (tmp_path / "never").exists()


def test_a_worker_gives_back_a_job_whose_call_was_stopped_from_outside(
    tmp_path: Path, token: Path
) -> None:
    """A queue system ends call and worker at once: the case would be told as failed."""
    distributed = pytest.importorskip("distributed", reason="of the extra cluster")
    with pytest.raises(distributed.Reschedule):
        at_work(long_job(tmp_path), token, lambda child: child.terminate(), carry_out_on_worker)
    other = at_work(long_job(tmp_path / "b"), token, lambda child: child.terminate())
    assert other == ("failed", "stopped from outside; run again to go on")


def at_work(
    made: Job,
    token: Path,
    act: Callable[[psutil.Process], None],
    work: Callable[[Job, int, Path], Outcome] = carry_out,
) -> tuple[str, str]:
    """How a job ends to whose process something happens in the middle of its work."""
    with ThreadPoolExecutor(1) as thread:
        ended = thread.submit(work, made, 1, token)
        while not (made.log.is_file() and "truth on a mesh" in made.log.read_text("utf-8")):
            time.sleep(0.05)
        (child,) = (p for p in psutil.Process().children() if "--end-with-input" in p.cmdline())
        act(child)
        outcome = ended.result(timeout=30.0)
    assert not child.is_running()
    return outcome.status, outcome.why


SCRIPT = """
import sys
from pathlib import Path
from driver.batch.calls import Outcome, carry_out, carry_out_on_worker
from tests.driver.batch.test_calls import long_job
carry_out(long_job(Path(sys.argv[1])), 1, Path(sys.argv[2]))
"""


def test_calls_end_with_the_process_that_makes_them(tmp_path: Path, token: Path) -> None:
    """They would work on, and keep the next run away from their cases."""
    asker = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path), str(token)],
        env=os.environ | {"PYTHONPATH": str(PACKAGES)},
    )
    log = tmp_path / "logs" / "a.log"
    while not (log.is_file() and "truth on a mesh" in log.read_text("utf-8")):
        assert asker.poll() is None
        time.sleep(0.05)
    (child,) = psutil.Process(asker.pid).children()
    asker.send_signal(signal.SIGKILL)
    asker.wait(timeout=30)
    _, living = psutil.wait_procs([child], timeout=30)
    assert not living


def test_a_job_whose_token_nobody_touches_any_more_stops(
    tmp_path: Path, token: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a cluster nothing else tells a worker that the campaign is gone."""
    monkeypatch.setattr(calls, "_SELDOM", 0.0)
    alive = calls.Token(token, tmp_path / "clock")
    assert not alive.gone() and not alive.gone()
    long_ago = time.time() - 2 * calls._STALE
    os.utime(token, (long_ago, long_ago))
    assert not alive.gone() and alive.gone()
    token.touch()
    assert not alive.gone()


def test_an_experiment_that_was_cut_off_is_made_from_nothing_and_a_whole_one_not_again(
    tmp_path: Path, token: Path
) -> None:
    folder = tmp_path / "made"
    (folder / ".aside").mkdir(parents=True)
    made = replace(
        job(folder, "a", ("init", str(folder)), ("init", str(tmp_path / "next"))), made=folder,
        log=tmp_path / "a.log", lock=tmp_path / "a.lock",
    )  # fmt: skip
    assert carry_out(made, 1, token).status == "done" and not (folder / ".aside").exists()
    before = (folder / "case.toml").stat().st_mtime_ns
    again = replace(made, calls=(made.calls[0], ("init", str(tmp_path / "third"))))
    assert carry_out(again, 1, token).status == "done"
    assert (folder / "case.toml").stat().st_mtime_ns == before

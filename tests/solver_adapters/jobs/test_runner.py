"""Programs are watched and ended as whole trees, whoever dies first."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

from solver_adapters.jobs.runner import Ended, Limits, run_program
from solver_adapters.jobs.status import Status

PLENTY = Limits(memory=1000.0, wall_time=30.0)
# A child, and a grandchild that left its parent, its group and its session.
TREE = "sleep 600 & echo $! > child; setsid sh -c 'echo $$ > stray; exec sleep 600' & wait"


def sh(folder: Path, script: str, limits: Limits = PLENTY, **environment: str) -> Ended:
    return run_program(("sh", "-c", script), folder, limits, environment)


def soon(true: Callable[[], bool], seconds: float = 15.0) -> bool:
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if true():
            return True
        time.sleep(0.02)
    return False


def written(folder: Path) -> bool:
    return all(
        (folder / name).is_file() and (folder / name).read_text() for name in ("child", "stray")
    )


def alive(folder: Path) -> list[int]:
    pids = []
    for name in ("child", "stray"):
        # It may end between the look for it and the question to it.
        with suppress(psutil.NoSuchProcess):
            process = psutil.Process(int((folder / name).read_text()))
            if process.status() != psutil.STATUS_ZOMBIE:
                pids.append(process.pid)
    return pids


def test_a_program_runs_in_its_folder_and_its_output_is_kept(tmp_path: Path) -> None:
    ended = sh(tmp_path, "pwd; echo $WORD >&2; exit 3", WORD="mine")
    assert (ended.status, ended.code, ended.limit) == (None, 3, None)
    assert (tmp_path / "stdout.txt").read_text() == f"{tmp_path}\n"
    assert (tmp_path / "stderr.txt").read_text() == "mine\n"


def test_it_has_a_session_of_its_own_and_no_input(tmp_path: Path) -> None:
    code = "import os, sys; print(os.getsid(0), repr(sys.stdin.read()))"
    run_program((sys.executable, "-c", code), tmp_path, PLENTY, {})
    session, read = (tmp_path / "stdout.txt").read_text().split()
    assert int(session) != os.getsid(0) and read == "''"


def test_a_wall_clock_limit_ends_the_whole_tree(tmp_path: Path) -> None:
    ended = sh(tmp_path, TREE, Limits(1000.0, wall_time=1.0))
    assert (ended.status, ended.limit) == (Status.OUT_OF_TIME, "wall_time")
    assert 1.0 <= ended.wall < 6.0
    assert written(tmp_path) and alive(tmp_path) == []


def test_who_does_not_listen_is_ended_all_the_same(tmp_path: Path) -> None:
    deaf = "trap '' TERM; " + TREE + "; sleep 600"
    ended = sh(tmp_path, deaf, Limits(1000.0, wall_time=1.0))
    assert ended.status is Status.OUT_OF_TIME
    assert written(tmp_path) and alive(tmp_path) == []


def test_cpu_time_is_that_of_all_processes_the_ended_ones_included(tmp_path: Path) -> None:
    """Children of 0.2 s each, one after the other: none alone passes the limit."""
    burn = (
        "import time\\nend = time.process_time() + 0.2\\nwhile time.process_time() < end: pass"
    ).replace("\\n", "\n")
    (tmp_path / "burn.py").write_text(burn)
    ended = sh(
        tmp_path,
        f"while true; do {sys.executable} -S burn.py; done",
        Limits(1000.0, wall_time=120.0, cpu_time=1.0),
    )
    assert (ended.status, ended.limit) == (Status.OUT_OF_TIME, "cpu_time")
    assert 1.0 <= ended.cpu < 3.0
    ended = sh(tmp_path, f"{sys.executable} -S burn.py; {sys.executable} -S burn.py")
    assert ended.status is None and 0.4 <= ended.cpu < 1.5


def test_memory_is_that_of_all_processes_together(tmp_path: Path) -> None:
    hold = f"{sys.executable} -S -c 'b = bytearray(120_000_000); print(flush=True); input()'"
    # Kept waiting by a pipe that nobody writes into.
    pair = f"mkfifo never; {hold} <> never & {hold} <> never & wait"
    ended = sh(tmp_path, pair, Limits(200.0, wall_time=60.0))
    assert (ended.status, ended.limit) == (Status.OUT_OF_MEMORY, "memory")
    assert ended.memory > 200.0
    one = sh(tmp_path, f"{hold} < /dev/null", Limits(200.0, wall_time=60.0))
    assert one.status is None


@pytest.mark.parametrize("script", ["kill -9 $$", "sh -c 'kill -15 $$'; exit $?"])
def test_a_program_that_was_killed_is_told_from_one_that_failed(
    tmp_path: Path, script: str
) -> None:
    assert sh(tmp_path, script).status is Status.KILLED


def test_a_crash_of_the_program_is_left_to_its_log(tmp_path: Path) -> None:
    ended = sh(tmp_path, "kill -SEGV $$")
    assert (ended.status, ended.code) == (None, -signal.SIGSEGV)


def test_a_program_that_is_not_there_is_missing(tmp_path: Path) -> None:
    ended = run_program(("no-such-program", "-x"), tmp_path, PLENTY, {})
    assert ended.status is Status.COMMAND_MISSING
    assert "no-such-program: No such file" in (tmp_path / "stderr.txt").read_text()


def test_what_a_program_leaves_running_is_ended_with_it(tmp_path: Path) -> None:
    ended = sh(tmp_path, TREE.removesuffix("wait") + "while ! test -s stray; do sleep 0.01; done")
    assert (ended.status, ended.code) == (None, 0)
    assert written(tmp_path) and alive(tmp_path) == []


DRIVER = """
import signal
import sys
from pathlib import Path
from solver_adapters.jobs.runner import Limits, run_program
# Who starts the tests in the background of a shell has them ignore Ctrl-C, and all they start.
signal.signal(signal.SIGINT, signal.default_int_handler)
try:
    run_program(("sh", "-c", sys.argv[2]), Path(sys.argv[1]), Limits(1000.0), {})
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_the_tree_ends_with_the_driver(tmp_path: Path, how: signal.Signals) -> None:
    command = [sys.executable, "-c", DRIVER, str(tmp_path), TREE]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as driver:
        assert soon(lambda: written(tmp_path))
        assert len(alive(tmp_path)) == 2
        driver.send_signal(how)
        out, _ = driver.communicate(timeout=20)
    assert soon(lambda: alive(tmp_path) == [])
    if how is signal.SIGINT:
        assert out == "interrupted\n"


def test_the_tree_ends_with_the_driver_though_a_fork_of_it_lives_on(tmp_path: Path) -> None:
    """The fork holds the driver's end of the pipe open."""
    fork = (
        "import os, threading, time\n"
        "def leave():\n"
        "    time.sleep(1.0)\n"
        "    pid = os.fork()\n"
        "    if pid == 0:\n"
        "        time.sleep(60)\n"
        "        os._exit(0)\n"
        f"    open({str(tmp_path / 'fork')!r}, 'w').write(str(pid))\n"
        "threading.Thread(target=leave).start()\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", fork + DRIVER, str(tmp_path), TREE]
    with subprocess.Popen(command) as driver:
        assert soon(lambda: written(tmp_path) and (tmp_path / "fork").is_file())
        assert soon(lambda: bool((tmp_path / "fork").read_text()))
        driver.kill()
    try:
        assert soon(lambda: alive(tmp_path) == [])
    finally:
        os.kill(int((tmp_path / "fork").read_text()), signal.SIGKILL)


def test_the_tree_ends_with_its_supervisor(tmp_path: Path) -> None:
    """The program dies with it (also the driver's other children are left alone)."""
    ends: list[Ended] = []
    thread = threading.Thread(target=lambda: ends.append(sh(tmp_path, TREE.replace("setsid ", ""))))
    thread.start()
    assert soon(lambda: written(tmp_path))
    (supervisor,) = (
        p for p in psutil.Process().children() if "supervisor.py" in " ".join(p.cmdline())
    )
    supervisor.kill()
    thread.join(20)
    assert ends[0].status is Status.KILLED
    assert soon(lambda: alive(tmp_path) == [])


def test_a_thread_that_waits_for_a_job_can_be_stopped(tmp_path: Path) -> None:
    stop, seen = threading.Event(), threading.Event()

    def heed() -> None:
        if stop.is_set():
            raise InterruptedError

    def work() -> None:
        with pytest.raises(InterruptedError):
            run_program(("sh", "-c", TREE), tmp_path, PLENTY, {}, heed)
        seen.set()

    thread = threading.Thread(target=work)
    thread.start()
    assert soon(lambda: written(tmp_path))
    stop.set()
    thread.join(20)
    assert seen.is_set() and alive(tmp_path) == []

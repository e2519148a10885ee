from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from driver.common.machine import cores
from driver.common.parallel import blas_on_one_thread, processes_kept, side_by_side
from solver_adapters.interface import PreparedError
from solver_adapters.kernels import PACKAGES
from solver_adapters.tasks import elsewhere


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_the_order_of_the_tasks(processes: int) -> None:
    ended: dict[int, float] = {}
    found = side_by_side(
        math.sqrt, [9.0, 4.0, 1.0, 16.0], processes, done=lambda i, root: ended.update({i: root})
    )
    assert found == [3.0, 2.0, 1.0, 4.0]
    assert ended == {0: 3.0, 1: 2.0, 2: 1.0, 3: 4.0}


@pytest.mark.parametrize("processes", [1, 2])
def test_a_failing_task_fails_the_whole(processes: int) -> None:
    with pytest.raises(ValueError):
        side_by_side(math.sqrt, [4.0, -1.0, 9.0], processes)


def eigenvalues(seed: int) -> list[float]:
    matrix = np.random.default_rng(seed).standard_normal((40, 40))
    return [float(value) for value in np.linalg.eigvalsh(matrix + matrix.T)]


def test_numbers_are_the_same_wherever_tasks_run() -> None:
    alone = side_by_side(eigenvalues, range(5), 1)
    assert side_by_side(eigenvalues, range(5), 2) == alone
    with ThreadPoolExecutor(3) as threads:
        assert side_by_side(eigenvalues, range(5), 2, executor=threads) == alone


class Counting(ThreadPoolExecutor):
    """An executor that counts what it is given."""

    given = 0

    def submit(self, *arguments: Any, **named: Any) -> Any:
        self.given += 1
        return super().submit(*arguments, **named)


def test_inside_of_elsewhere_an_executor_does_what_would_go_to_processes() -> None:
    with Counting(2) as executor:
        with elsewhere(executor):
            there = side_by_side(eigenvalues, range(5), 2)
            assert executor.given == 5
            side_by_side(eigenvalues, range(3), 1)
            assert executor.given == 5  # what is alone stays here
        assert there == side_by_side(eigenvalues, range(5), 2)
        assert executor.given == 5


def squares_of_both(task: int) -> list[float]:
    return side_by_side(math.sqrt, [float(task), 4.0], 2)


def test_a_task_of_an_executor_gives_it_no_tasks_that_would_wait_for_a_free_thread() -> None:
    with Counting(1) as executor, elsewhere(executor):
        assert side_by_side(squares_of_both, [1, 9], 2) == [[1.0, 2.0], [3.0, 2.0]]
    assert executor.given == 2


def test_no_more_tasks_are_given_to_an_executor_than_are_to_run_at_a_time() -> None:
    at_work: list[int] = []
    most: list[int] = []

    def work(task: int) -> int:
        at_work.append(task)
        time.sleep(0.02)
        most.append(len(at_work))
        at_work.remove(task)
        return task

    with ThreadPoolExecutor(8) as threads:
        assert side_by_side(work, range(12), 3, executor=threads) == list(range(12))
    assert max(most) <= 3


def test_what_fails_with_an_executor_gives_it_no_more_tasks() -> None:
    begun: list[int] = []

    def work(task: int) -> None:
        begun.append(task)
        raise ValueError(task)

    with ThreadPoolExecutor(1) as threads, pytest.raises(ValueError, match="0"):
        side_by_side(work, range(12), 1, executor=threads)
    assert len(begun) < 12


def pids_below(number: int) -> tuple[int, list[int]]:
    return os.getpid(), side_by_side(pid_of, range(number), 2)


def pid_of(task: int) -> int:
    return os.getpid()


def test_what_runs_side_by_side_takes_no_further_processes() -> None:
    """They would be more than the cores that were stated."""
    for own, below in side_by_side(pids_below, [3, 3], 2):
        assert own != os.getpid() and below == [own] * 3


def pids_of_two() -> set[int]:
    """Of processes that each do one of two tasks: the first waits for the second."""
    return set(side_by_side(pid_after_a_while, [0.3, 0.3], 2))


def pid_after_a_while(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def test_processes_that_are_kept_do_the_tasks_of_the_next_call_and_end_with_the_block() -> None:
    """Each takes seconds to start, and a diagnosis asks for them ten times."""
    with processes_kept():
        first = pids_of_two()
        assert pids_of_two() <= first
        assert side_by_side(os.getenv, ["OMP_NUM_THREADS"] * 2, 2, threads=2) == ["2", "2"]
        assert not pids_alive(list(first))  # others have another number of threads
        with pytest.raises(ValueError):
            side_by_side(math.sqrt, [-1.0, 4.0], 2)
        # What failed has ended its processes.
        last = pids_of_two()
        assert not last & first and len(pids_alive(list(last))) == len(last)
    assert not pids_alive(list(last))
    assert not pids_of_two() & last


def test_a_kept_process_that_the_system_ends_is_told_and_others_do_the_next_tasks() -> None:
    with processes_kept():
        with pytest.raises(ChildProcessError, match="^execution.processes: one of 2 processes"):
            side_by_side(os._exit, [9, 9, 9], 2)
        assert side_by_side(math.sqrt, [4.0, 9.0], 2) == [2.0, 3.0]


def test_a_call_as_results_are_taken_leaves_the_kept_processes_to_the_outer_one() -> None:
    """It asks for another number of processes while tasks of the outer call still wait."""
    inner: list[float] = []

    def taken(index: int, result: float) -> None:
        if index == 0:
            inner.extend(side_by_side(math.sqrt, [16.0, 25.0, 36.0], 3))

    with processes_kept():
        roots = side_by_side(math.sqrt, [float(k * k) for k in range(8)], 2, done=taken)
    assert roots == list(range(8)) and inner == [4.0, 5.0, 6.0]


def threads_of_blas(task: int) -> list[int]:
    return [found["num_threads"] for found in threadpool_info() if found["user_api"] == "blas"]


@pytest.mark.parametrize("threads", [1, 2])
def test_blas_has_one_thread_whatever_those_of_its_process(threads: int) -> None:
    for found in side_by_side(threads_of_blas, [0, 1], 2, threads):
        assert found and set(found) == {1}


@pytest.mark.skipif(cores() < 2, reason="one core has one thread")
def test_blas_keeps_to_one_thread_until_the_last_task_beside_it_has_ended() -> None:
    first, second = blas_on_one_thread(), blas_on_one_thread()
    with threadpool_limits(2, "blas"):
        with first:
            second.__enter__()
        assert set(threads_of_blas(0)) == {1}
        second.__exit__(None, None, None)
        assert 2 in threads_of_blas(0)


def prepared_unless_even(number: int) -> int:
    if number % 2:
        raise PreparedError([Path("jobs/common"), Path(f"jobs/{number}")])
    return number


@pytest.mark.parametrize("processes", [1, 2])
def test_jobs_that_are_prepared_are_those_of_all_tasks(processes: int) -> None:
    """Else each run would prepare those of one task, and wait for another machine."""
    ended = []
    with pytest.raises(PreparedError) as error:
        side_by_side(prepared_unless_even, [1, 2, 3], processes, done=lambda i, n: ended.append(n))
    assert sorted(error.value.folders) == [Path(f"jobs/{name}") for name in ("1", "3", "common")]
    assert len(error.value.folders) == 3 and ended == [2]


def test_a_process_that_the_system_ends_is_told_with_what_helps() -> None:
    with pytest.raises(
        ChildProcessError, match="^execution.processes: one of 2 processes .* fewer"
    ):
        side_by_side(os._exit, [9, 9, 9], 2)


def test_each_process_has_its_threads_and_this_one_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]
    assert side_by_side(os.getenv, names, 2, threads=1) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ


def test_more_threads_than_the_machine_has_are_as_many_as_it_has() -> None:
    assert side_by_side(math.sqrt, [4.0, 9.0], 2, threads=4096) == [2.0, 3.0]


def fail_or_work(task: tuple[int, bytes]) -> None:
    number, _ = task
    if number == 0:
        raise ValueError("the first")
    time.sleep(60.0)


FAIL = """
from tests.driver.common.test_parallel import *
if __name__ == "__main__":
    try:
        side_by_side(fail_or_work, [(i, bytes(10**6)) for i in range(5)], 2)
    except ValueError as error:
        print(error)
"""


def test_what_fails_ends_the_others_whose_tasks_are_larger_than_a_pipe(tmp_path: Path) -> None:
    """Tasks of which no process takes any more stood in the way of the end, for ever."""
    script = tmp_path / "script.py"
    script.write_text(FAIL)
    folder = tmp_path / "temporary"
    folder.mkdir()
    ended = subprocess.run(
        [sys.executable, script],
        env={**os.environ, "PYTHONPATH": str(PACKAGES), "TMPDIR": str(folder)},
        capture_output=True,
        text=True,
        timeout=45,
    )
    assert (ended.stdout, ended.stderr, ended.returncode) == ("the first\n", "", 0)
    assert not list(folder.iterdir())


@pytest.mark.parametrize("processes", [1, 2])
def test_results_larger_than_a_pipe_come_back(processes: int) -> None:
    assert side_by_side(bytes, [10**6, 3, 2 * 10**6], processes) == [
        bytes(10**6),
        bytes(3),
        bytes(2 * 10**6),
    ]


def test_ctrl_c_in_a_terminal_ends_all_processes_without_a_word_of_theirs(tmp_path: Path) -> None:
    """The terminal interrupts the whole group."""
    with at_work(tmp_path) as (group, pids):
        os.killpg(group.pid, signal.SIGINT)
        said, complaints = group.communicate(timeout=30)
        assert (said, complaints, group.returncode) == ("stopped\n", "", 0)
        assert all(task.with_suffix(".tidy").exists() for task in marks(tmp_path))
        for pid in pids:
            with pytest.raises(ProcessLookupError):
                os.kill(pid, 0)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM])
def test_processes_end_with_the_one_that_gives_the_tasks(
    tmp_path: Path, how: signal.Signals
) -> None:
    """They waited for another task for ever, each with its memory."""
    with at_work(tmp_path) as (group, pids):
        group.send_signal(how)
        group.wait(timeout=30)
        _, living = psutil.wait_procs(pids_alive(pids), timeout=30)
        assert not living
    assert all(task.with_suffix(".tidy").exists() for task in marks(tmp_path))
    assert not list(tmp_path.glob("prismid-*"))


HELD = """
import ctypes, os, sys
from pathlib import Path
from driver.common.parallel import side_by_side
def hold(task):
    Path(task).write_text(str(os.getpid()))
    ctypes.PyDLL(None).sleep(60)  # with the lock of Python
if __name__ == "__main__":
    side_by_side(hold, sys.argv[1:], 2)
"""


def test_processes_that_hold_the_lock_of_python_end_with_the_one_that_gives_the_tasks(
    tmp_path: Path,
) -> None:
    (tmp_path / "script.py").write_text(HELD)
    tasks = [tmp_path / "first", tmp_path / "second"]
    with subprocess.Popen(
        [sys.executable, tmp_path / "script.py", *tasks],
        env={**os.environ, "PYTHONPATH": str(PACKAGES), "TMPDIR": str(tmp_path)},
    ) as asker:
        late = time.monotonic() + 60.0
        while not all(task.exists() and task.read_text() for task in tasks):
            assert time.monotonic() < late
            time.sleep(0.05)
        asker.kill()
    _, living = psutil.wait_procs(pids_alive([int(task.read_text()) for task in tasks]), timeout=5)
    assert not living


def pids_alive(pids: list[int]) -> list[psutil.Process]:
    found = []
    for pid in pids:
        with suppress(psutil.NoSuchProcess):
            found.append(psutil.Process(pid))
    return found


def marks(folder: Path) -> list[Path]:
    """What tasks write: two of a minute, and one whose process waits for another."""
    return [folder / name for name in ("first", "second", "short")]


@contextmanager
def at_work(folder: Path) -> Iterator[tuple[subprocess.Popen[str], list[int]]]:
    """Three tasks side by side in a process group of their own, and the processes that do them."""
    tasks = marks(folder)
    script = folder / "script.py"
    script.write_text(
        "import signal\n"
        "from tests.driver.common.test_parallel import *\n"
        "if __name__ == '__main__':\n"
        # What runs in the background of a shell ignores Ctrl-C unless it says otherwise.
        "    signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "    try:\n"
        f"        side_by_side(mark_and_work, [Path(t) for t in {[str(t) for t in tasks]}], 3)\n"
        "    except KeyboardInterrupt:\n"
        "        print('stopped')\n"
    )
    group = subprocess.Popen(
        [sys.executable, script],
        env={**os.environ, "PYTHONPATH": str(PACKAGES), "TMPDIR": str(folder)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
        text=True,
    )
    try:
        late = time.monotonic() + 60.0
        while not all(task.exists() for task in tasks) and time.monotonic() < late:
            time.sleep(0.05)
        time.sleep(0.5)  # the process of the short task waits for another one
        yield group, [int(task.read_text()) for task in tasks]
    finally:
        with suppress(ProcessLookupError):
            os.killpg(group.pid, signal.SIGKILL)
        group.communicate()


def mark_and_work(task: Path) -> None:
    """Say which process is at work, and be at work."""
    aside = task.with_suffix(".part")
    aside.write_text(str(os.getpid()))
    aside.rename(task)
    try:
        time.sleep(0.0 if task.name == "short" else 60.0)
    finally:
        task.with_suffix(".tidy").touch()


def test_no_tasks_have_no_results() -> None:
    assert side_by_side(math.sqrt, [], 4) == []


def test_processes_import_nothing_from_the_folder_of_the_call(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    trap = "raise SystemExit('imported from the folder of the call')"
    for name in ("multiprocessing", "signal", "random", "numpy", "driver"):
        (tmp_path / f"{name}.py").write_text(trap)
    monkeypatch.chdir(tmp_path)
    assert side_by_side(math.sqrt, [9.0, 4.0], 2) == [3.0, 2.0]


SWALLOWING = """
import ctypes, os, signal, sys, time
from driver.common import parallel

def terminate(): os.kill(os.getpid(), signal.SIGTERM)

class Interrupted(parallel.SimpleQueue):
    times = 0
    def put(self, item):
        type(self).times += 1
        if self.times == 1 and len(sys.argv) > 1:
            terminate()
        super().put(item)

parallel.SimpleQueue = Interrupted
parallel.hear_swallowed_exits()
signal.signal(signal.SIGTERM, lambda *_: sys.exit(7))
ctypes.CFUNCTYPE(None)(terminate)()
time.sleep(60)
"""


@pytest.mark.parametrize("again", [[], ["while the first is heard of"]])
def test_an_exit_that_a_callback_of_c_swallows_comes_once_more_and_shows_no_traceback(
    again: list[str],
) -> None:
    call = [sys.executable, "-c", SWALLOWING, *again]
    ended = subprocess.run(call, capture_output=True, timeout=40)
    assert ended.returncode == 7 and ended.stderr == b""

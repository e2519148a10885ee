"""Independent tasks side by side: in own processes, or wherever an executor has them run."""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from contextvars import ContextVar
from functools import lru_cache, partial
from itertools import count, islice
from multiprocessing import connection
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

from threadpoolctl import ThreadpoolController

from solver_adapters.interface import PreparedError
from solver_adapters.kernels import use_threads
from solver_adapters.tasks import as_one_of_several, executor_elsewhere, is_one_of_several

Task = TypeVar("Task")
Result = TypeVar("Result")

_OF_BLAS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
THREAD_VARIABLES = ("OMP_NUM_THREADS", *_OF_BLAS)
"""Limits of numerical libraries that would each start as many threads as there are cores."""

_SAFE_PATH = "PYTHONSAFEPATH"
"""Keeps the current folder, where anybody's files lie, from what Python imports from."""

_PR_SET_PDEATHSIG = 1
_SECONDS_LEFT = int(signal.SIGQUIT)
"""Seconds that a process lives on after the one that gives its tasks, and a signal: both are 3."""

_AGAIN = 0.05  # s until a signal whose exit was swallowed comes once more

_ENDED = (
    "execution.processes: one of {} processes side by side was ended by the system, most likely "
    "for want of memory; expected fewer, each needs its own"
)


def side_by_side(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    processes: int,
    threads: int = 1,
    done: Callable[[int, Result], None] | None = None,
    executor: Executor | None = None,
) -> list[Result]:
    """Results of `work` on each task, in the order of the tasks; the same ones wherever they run.

    Args:
        work: a function of a module (it is sent to the processes by name); any, for one process.
        tasks: what it is called with.
        processes: how many run at a time; one is this one. A process that is itself one of several
            takes no others, so that those of all levels together are as many as were stated.
        threads: threads of each.
        done: called with index and result as each task ends.
        executor: where they run; if left out, that of `elsewhere`, else processes of this machine,
            which end with this one.

    Raises:
        PreparedError: jobs were prepared instead of being run, those of all tasks.
        ChildProcessError: the system ended a process.
        Whatever the first failing task raised; the others are ended, or with an executor those that
        have not begun. So they are after Ctrl-C, which this process alone hears, and where this
        process dies.
    """
    results: dict[int, Result] = {}
    prepared: list[PreparedError] = []

    def take(index: int, result: Callable[[], Result]) -> None:
        try:
            results[index] = result()
        except PreparedError as error:
            prepared.append(error)
        else:
            if done is not None:
                done(index, results[index])

    at_a_time = min(processes, len(tasks))
    here = at_a_time <= 1 or is_one_of_several()
    if executor is None and not here:
        executor = executor_elsewhere()
    if executor is not None:
        packed = (pickle.dumps(task, pickle.HIGHEST_PROTOCOL) for task in tasks)
        there = partial(_with_threads, work, threads)
        _map(executor, there, packed, max(at_a_time, 1), partial(_take_packed, take))
    elif here:
        for index, task in enumerate(tasks):
            take(index, partial(work, task))
    else:
        with _processes(at_a_time, processes, threads) as own:
            _map(own, work, tasks, at_a_time, take)
    if prepared:
        raise PreparedError.together(prepared)
    return [results[index] for index in range(len(tasks))]


def _map(
    executor: Executor,
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    at_a_time: int,
    take: Callable[[int, Callable[[], Result]], None],
) -> None:
    """Hand over index and result of each task as it ends; where that raises, cancel the others."""
    waiting = iter(enumerate(tasks))
    at_work: dict[Future[Result], int] = {}

    def give(amount: int) -> None:
        for index, task in islice(waiting, amount):
            at_work[executor.submit(work, task)] = index

    try:
        give(at_a_time)
        while at_work:
            ended = wait(at_work, return_when=FIRST_COMPLETED).done
            give(len(ended))
            for future in ended:
                take(at_work.pop(future), future.result)
    except BaseException:
        for future in at_work:
            future.cancel()
        raise


def _with_threads(work: Callable[[Task], Result], threads: int, packed: bytes) -> bytes:
    """Do a task in a process that others use, too.

    Task and result go as they do to processes of this machine: a cluster would lay arrays out in
    its own way, and sums over them would round otherwise.
    """
    use_threads(threads)
    with as_one_of_several(), blas_on_one_thread():
        return pickle.dumps(work(pickle.loads(packed)), pickle.HIGHEST_PROTOCOL)


def _take_packed(
    take: Callable[[int, Callable[[], Any]], None], index: int, result: Callable[[], bytes]
) -> None:
    take(index, lambda: pickle.loads(result()))


@contextmanager
def processes_kept() -> Iterator[None]:
    """Let processes that have done their tasks wait inside for those of the next call.

    Each takes some seconds to start, for its libraries and kernels. Where a task fails they end,
    and the next call starts others.
    """
    with ExitStack() as ended:
        kept = _Kept(ended)
        token = _kept.set(kept)
        ended.callback(_kept.reset, token)
        yield


class _Kept:
    """Processes that wait for tasks.

    Args:
        ended: what ends them at last.
    """

    def __init__(self, ended: ExitStack) -> None:
        self._asked: tuple[int, int] | None = None
        self._started = ended.enter_context(ExitStack())
        self._executor: Executor

    def started(self, processes: int, threads: int) -> Executor:
        """Return so many processes of so many threads."""
        if self._asked != (processes, threads):
            self._started.close()
            self._executor = self._started.enter_context(_own_processes(processes, threads))
            self._asked = processes, threads
        return self._executor

    def fail(self) -> None:
        """End them at once, for what is raised."""
        self._asked = None
        self._started.__exit__(*sys.exc_info())


_kept: ContextVar[_Kept | None] = ContextVar("_kept", default=None)


@contextmanager
def _processes(at_a_time: int, processes: int, threads: int) -> Iterator[Executor]:
    """Take those that wait, or start some that end with the block."""
    kept = _kept.get()
    if kept is None:
        with _own_processes(at_a_time, threads) as own:
            yield own
        return
    token = _kept.set(None)  # a call from inside, as results are taken, starts its own
    try:
        yield kept.started(processes, threads)
    except BaseException:
        kept.fail()
        raise
    finally:
        _kept.reset(token)


@contextmanager
def _own_processes(processes: int, threads: int) -> Iterator[Executor]:
    """Start processes, which end with this one, and at once where the block raises.

    Raises:
        ChildProcessError: the system ended one of them.
    """
    with (
        TemporaryDirectory(prefix="prismid-") as name,
        ProcessPoolExecutor(
            max_workers=processes,
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_begin,
            initargs=(threads, Path(name)),
        ) as pool,
    ):
        others = multiprocessing.active_children()
        try:
            yield _ThroughFiles(pool, Path(name), threads)
        except BaseException as error:
            for process in multiprocessing.active_children():
                if process not in others:
                    process.terminate()
            if isinstance(error, BrokenProcessPool):
                raise ChildProcessError(_ENDED.format(processes)) from None
            raise


class _ThroughFiles(Executor):
    """Hands tasks to a pool and takes results from it through files.

    Its pipes carry a path each and are never full, else a process that is ended would leave this
    one waiting for it.

    Args:
        pool: of processes.
        folder: for the files.
        threads: of each process.
    """

    def __init__(self, pool: ProcessPoolExecutor, folder: Path, threads: int) -> None:
        self._pool, self._folder, self._numbers = pool, folder, count()
        self._environment = (
            dict.fromkeys(THREAD_VARIABLES, "1")
            | {"OMP_NUM_THREADS": str(threads)}
            | {_SAFE_PATH: "1"}  # a process imports nothing from this folder
        )

    def submit(self, work: Any, task: Any, /) -> Future[Any]:  # type: ignore[override]
        """Hand a task over."""
        index = next(self._numbers)
        _write(_task_file(self._folder, index), task)
        result: Future[Any] = Future()
        result.set_running_or_notify_cancel()

        def take(written: Future[None]) -> None:
            try:
                written.result()
                result.set_result(_taken(_result_file(self._folder, index)))
            except BaseException as error:
                result.set_exception(error)

        # Any of them may start a process.
        with _deaf_to_interrupts(), _environment(self._environment):
            self._pool.submit(_carry_out, work, self._folder, index).add_done_callback(take)
        return result


def _carry_out(work: Callable[[Any], Any], folder: Path, index: int) -> None:
    """Do the task of a number."""
    try:
        # A task that is ended tidies up, as after Ctrl-C; between tasks there is nothing to tidy.
        signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
        try:
            _write(_result_file(folder, index), work(_taken(_task_file(folder, index))))
        finally:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)
    except SystemExit:  # the pool would take it for the task's, and go on
        os._exit(1)


def _task_file(folder: Path, index: int) -> Path:
    return folder / f"{index}.task"


def _result_file(folder: Path, index: int) -> Path:
    return folder / f"{index}.result"


def _write(path: Path, what: object) -> None:
    try:
        with path.open("wb") as file:
            pickle.dump(what, file, pickle.HIGHEST_PROTOCOL)
    except OSError as error:  # a full disk names no file
        raise OSError(error.errno, error.strerror, str(path)) from None


def _taken(path: Path) -> Any:
    """Return what stands in the file, which has served then."""
    with path.open("rb") as file:
        what = pickle.load(file)
    path.unlink()
    return what


def _begin(threads: int, folder: Path) -> None:
    """Prepare a process."""
    use_threads(threads)
    hear_swallowed_exits()
    _end_soon_after_asker()
    threading.Thread(target=_end_with_asker, args=(folder,), daemon=True).start()


def hear_swallowed_exits() -> None:
    """Let SIGTERM end this process although it came while a callback of C ran.

    A library that calls back, as the compiler of the kernels does, swallows the exit that the
    signal asks for: the signal comes once more.
    """
    swallowed: SimpleQueue[None] = SimpleQueue()

    def told(raised: Any) -> None:
        if not issubclass(raised.exc_type, SystemExit):
            sys.__unraisablehook__(raised)
            return
        try:
            swallowed.put(None)
        except SystemExit:  # the signal came again, right here, where C swallows it as well
            swallowed.put(None)

    def say_again() -> None:
        while True:
            swallowed.get()
            time.sleep(_AGAIN)
            while not swallowed.empty():
                swallowed.get()
            _terminate_main_thread()

    threading.Thread(target=say_again, daemon=True).start()
    sys.unraisablehook = told


def _terminate_main_thread() -> None:
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGTERM)


def _end_soon_after_asker() -> None:
    """Let the system end this process where the one that gives the tasks has died.

    C code that holds the lock of Python keeps it from hearing of that, for as long as it takes. The
    system sends a signal, and what answers it is no Python: `alarm` of C, which takes the number of
    the signal for seconds. Until these are over a task can tidy up.
    """
    if not sys.platform.startswith("linux"):
        return
    libc, asker = ctypes.CDLL(None), multiprocessing.parent_process()
    libc.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
    libc.signal(_SECONDS_LEFT, ctypes.cast(libc.alarm, ctypes.c_void_p))
    libc.prctl(_PR_SET_PDEATHSIG, _SECONDS_LEFT)
    if asker is not None and os.getppid() != asker.pid:  # it has died before
        signal.alarm(_SECONDS_LEFT)


def _end_with_asker(folder: Path) -> None:
    """Where the process that gives the tasks dies, the pool alone would wait for ever."""
    asker = multiprocessing.parent_process()
    assert asker is not None
    connection.wait([asker.sentinel])
    shutil.rmtree(folder, ignore_errors=True)
    _terminate_main_thread()


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Keep Ctrl-C, which a terminal sends to all processes, from those that start inside."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def blas_on_one_thread() -> Iterator[None]:
    """Let BLAS sum in one order, whatever the cores: it sums in as many parts as it has threads.

    The limit is that of the process, and ends with the last thread that is inside.
    """
    global _inside
    with _entering:
        if not _inside:
            # The variables are for a library that is loaded inside.
            _limits.enter_context(_environment(dict.fromkeys(_OF_BLAS, "1")))
            _limits.enter_context(_libraries(len(sys.modules)).limit(limits=1, user_api="blas"))
        _inside += 1
    try:
        yield
    finally:
        with _entering:
            _inside -= 1
            if not _inside:
                _limits.close()


@lru_cache(maxsize=1)
def _libraries(_modules: int) -> ThreadpoolController:
    """Return the numerical libraries that are loaded: sought anew where modules have come since."""
    return ThreadpoolController()


_entering, _limits = threading.Lock(), ExitStack()
_inside = 0  # threads that BLAS is limited for


@contextmanager
def _environment(inside: Mapping[str, str]) -> Iterator[None]:
    """Set variables of the environment, which processes that start inside inherit."""
    before = {name: os.environ.get(name) for name in inside}
    os.environ.update(inside)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value

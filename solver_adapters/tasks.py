"""Where tasks run that go side by side, and whether this code is one of them."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing import parent_process

_task: ContextVar[bool] = ContextVar("task", default=False)
_elsewhere: ContextVar[Executor | None] = ContextVar("elsewhere", default=None)


@contextmanager
def elsewhere(executor: Executor) -> Iterator[None]:
    """Let an executor run what goes side by side inside."""
    token = _elsewhere.set(executor)
    try:
        yield
    finally:
        _elsewhere.reset(token)


def executor_elsewhere() -> Executor | None:
    """Return the executor of `elsewhere`, None outside of it and in a task."""
    return None if is_one_of_several() else _elsewhere.get()


@contextmanager
def as_one_of_several() -> Iterator[None]:
    """Do what is inside as one of several tasks, which takes no further cores."""
    token = _task.set(True)
    try:
        yield
    finally:
        _task.reset(token)


def is_one_of_several() -> bool:
    """Whether others run beside this code: it is a task, or its process is there for tasks."""
    return _task.get() or parent_process() is not None

"""Whether this code is one of several tasks side by side, which takes no further cores."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from multiprocessing import parent_process

_task: ContextVar[bool] = ContextVar("task", default=False)


@contextmanager
def as_one_of_several() -> Iterator[None]:
    """Do what is inside as one of several tasks, wherever it runs."""
    token = _task.set(True)
    try:
        yield
    finally:
        _task.reset(token)


def is_one_of_several() -> bool:
    """Whether others run beside this code: it is a task, or its process is there for tasks."""
    return _task.get() or parent_process() is not None

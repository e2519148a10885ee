"""Kernels that only other kernels can call, as functions that a test calls."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from types import ModuleType
from typing import Any

from numba import njit
from numba.core.dispatcher import Dispatcher


@cache
def from_python(kernel: Any) -> Callable[..., Any]:
    """The kernel as it is compiled, with a way in."""

    def call(*given: Any) -> Any:
        return kernel(*given)

    made: Callable[..., Any] = njit(call)
    return made


class FromPython:
    """All kernels of a module."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module

    def __getattr__(self, name: str) -> Callable[..., Any]:
        kernel = getattr(self._module, name)
        assert isinstance(kernel, Dispatcher)
        return from_python(kernel)

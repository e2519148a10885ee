"""What is expected of a value at the border, said in one sentence where it is not so."""

from __future__ import annotations

from numbers import Real
from typing import Any

import numpy as np

from meshes.arrays import AnyArray
from solver_adapters.interface import BadSimulationError


def expect_number(name: str, value: Any) -> None:
    """Raise where a value is no real number."""
    if not isinstance(value, Real) or isinstance(value, bool):
        raise BadSimulationError(f"{name} is {value!r}; expected a number")


def expect_array(name: str, array: Any) -> None:
    """Raise where a value is no array of real numbers."""
    if not isinstance(array, np.ndarray):
        raise BadSimulationError(f"{name} is a {type(array).__name__}; expected an array")
    if array.dtype.kind not in "biuf":
        raise BadSimulationError(f"{name} holds {array.dtype}; expected real numbers")


def expect_shape(name: str, array: AnyArray, shape: tuple[int | None, ...]) -> None:
    """Raise where an array has another shape; None stands for any size."""
    expect_array(name, array)
    fits = array.ndim == len(shape) and all(
        wanted in (None, size) for size, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits:
        words = ", ".join("n" if size is None else str(size) for size in shape)
        raise BadSimulationError(
            f"{name} has shape {array.shape}; expected ({words}{',' if len(shape) == 1 else ''})"
        )


def expect_finite(name: str, array: AnyArray) -> None:
    """Raise where an array holds a value that is not finite."""
    bad = array.size - np.count_nonzero(np.isfinite(array))
    if bad:
        raise BadSimulationError(
            f"{name} holds {bad} values that are not finite; expected finite numbers"
        )


def expect_integers(name: str, array: AnyArray) -> None:
    """Raise where an array does not hold integers."""
    if not np.issubdtype(array.dtype, np.integer):
        raise BadSimulationError(f"{name} holds {array.dtype}; expected integers")


def expect_indices(name: str, array: AnyArray, count: int, what: str) -> None:
    """Raise where an array does not index `count` things."""
    expect_integers(name, array)
    bad = array[(array < 0) | (array >= count)]
    if bad.size:
        raise BadSimulationError(
            f"{name} holds {bad[0]}, but there are {count} {what}; expected 0 to {count - 1}"
        )


def expect_increasing(name: str, array: AnyArray) -> None:
    """Raise where an array does not increase."""
    back = np.flatnonzero(np.diff(array) <= 0)
    if back.size:
        i = int(back[0])
        raise BadSimulationError(
            f"{name} goes from {array[i]:g} to {array[i + 1]:g} at place {i + 1}; "
            "expected increasing values"
        )

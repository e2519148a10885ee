"""Arrays with names, units and coordinates: what a dimension is stands with the numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from driver.common.errors import InputError
from driver.parameters.registry import label_of
from meshes.arrays import AnyArray, FloatArray

if TYPE_CHECKING:
    import xarray

COMPONENTS = ("u", "v", "w")
"""Of a motion: along X, Y, Z."""
Variable = tuple[tuple[str, ...], AnyArray, str, str]
"""Dimensions, values, unit and words of a variable."""


class LibraryError(InputError):
    """A library that is not installed with prismid."""


def xarray_library() -> Any:
    """Return the module `xarray`.

    Raises:
        LibraryError: it is not installed.
    """
    try:
        import xarray
    except ModuleNotFoundError:
        raise LibraryError(
            'xarray: found no such library, expected `pip install "prismid[xarray]"` before'
        ) from None
    return xarray


def dataset(
    variables: Mapping[str, Variable],
    coordinates: Mapping[str, Variable],
    attributes: Mapping[str, Any] | None = None,
) -> xarray.Dataset:
    """Return a dataset; units and words stand in `units` and `long_name` of each variable.

    Raises:
        LibraryError: xarray is not installed.
    """
    made: xarray.Dataset = xarray_library().Dataset(
        {name: _described(one) for name, one in variables.items()},
        {name: _described(one) for name, one in coordinates.items()},
        dict(attributes or {}),
    )
    return made


def _described(variable: Variable) -> tuple[tuple[str, ...], AnyArray, dict[str, str]]:
    dimensions, values, unit, words = variable
    told = {"units": unit, "long_name": words}
    return dimensions, values, {key: text for key, text in told.items() if text}


def of_images(time: FloatArray, stage: FloatArray, cycle: AnyArray) -> dict[str, Variable]:
    """Coordinates of T images: instants [s], stage travel [µm] and cycle, each of shape (T,)."""
    return {
        "image": (("image",), np.arange(len(time)), "", "image, 0 before loading"),
        "time": (("image",), time, "s", "time"),
        "stage": (("image",), stage, "µm", "stage travel"),
        "cycle": (("image",), np.asarray(cycle, dtype=np.int64), "", "cycle, from 1"),
    }


def of_points(xy: FloatArray) -> dict[str, Variable]:
    """Coordinates of points of the face: X, Y [µm], shape (n, 2); components of their motion."""
    return {
        "X": (("point",), xy[:, 0], "µm", "X, across the face"),
        "Y": (("point",), xy[:, 1], "µm", "Y, along the loading axis"),
        "component": (("component",), np.array(COMPONENTS), "", "motion along X, Y, Z"),
    }


def of_parameters(names: Iterable[str], units: Iterable[str]) -> dict[str, Variable]:
    """Coordinates of parameters: their names, units and labels."""
    named, along = list(names), ("parameter",)
    return {
        "parameter": (along, np.array(named), "", ""),
        "unit": (along, np.array(list(units)), "", ""),
        "label": (along, np.array([label_of(name) for name in named]), "", ""),
    }

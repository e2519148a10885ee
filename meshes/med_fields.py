"""Fields over time in MED files: at nodes, in cells and at the Gauss points of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import h5py
import medcoupling as mc
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Place = Literal["nodes", "cells", "points"]

_KINDS: dict[Place, int] = {
    "nodes": mc.ON_NODES,
    "cells": mc.ON_CELLS,
    "points": mc.ON_GAUSS_PT,
}
_VOLUME_CELLS = 0  # level of a MED mesh, relative to its dimension


@dataclass(frozen=True, eq=False)
class MedField:
    """A field over time.

    Attributes:
        name: name of the field.
        place: where its values are: nodes, cells, or the Gauss points of cells.
        components: name of each of the k components.
        units: unit of each, empty where the file states none.
        times: instants [s], shape (T,).
        values: shape (T, n, k), of Gauss points (T, n, n_gauss, k).
        ids: the n nodes or cells that have values, in the order of the file, shape (n,); empty
            for all of them in a field that is to be written.
    """

    name: str
    place: Place
    components: tuple[str, ...]
    units: tuple[str, ...]
    times: FloatArray
    values: FloatArray
    ids: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))


def add_med_fields(path: Path, fields: Sequence[MedField]) -> None:
    """Add fields at all nodes or in all cells to a file that holds one mesh.

    Args:
        path: the MED file.
        fields: what to add, at nodes or in cells, for every one of them, in the order of the file.

    Raises:
        ValueError: a field does not have one value for every node or cell.
    """
    mesh = mc.MEDFileUMesh(str(path))
    support = mesh.getMeshAtLevel(_VOLUME_CELLS)
    sizes = {"nodes": support.getNumberOfNodes(), "cells": support.getNumberOfCells()}
    for item in fields:
        expected = (len(item.times), sizes.get(item.place), len(item.components))
        if item.values.shape != expected:
            raise ValueError(
                f"{path}: field {item.name} at {item.place} has the shape "
                f"{item.values.shape}; expected {expected}"
            )
        series = mc.MEDFileFieldMultiTS()
        for step in range(len(item.times)):
            series.appendFieldNoProfileSBT(_instant(item, step, support))
        series.write(str(path), 0)  # 0: add to the file


def _instant(item: MedField, step: int, support: Any) -> Any:
    array = mc.DataArrayDouble(np.ascontiguousarray(item.values[step], dtype=np.float64))
    named = zip(item.components, item.units, strict=True)
    array.setInfoOnComponents([f"{name} [{unit}]" if unit else name for name, unit in named])
    one = mc.MEDCouplingFieldDouble(_KINDS[item.place], mc.ONE_TIME)
    one.setName(item.name)
    one.setMesh(support)
    one.setArray(array)
    one.setTime(float(item.times[step]), step, -1)
    one.setTimeUnit("s")
    return one


def read_med_fields(path: Path, names: Sequence[str] | None = None) -> dict[str, MedField]:
    """Fields of a MED file by name, at all their instants.

    Cells are those of the highest dimension, of one kind; fields of faces are left out. A field
    with values at several places (nodes and cells) counts as that of the first of nodes, cells,
    points.

    Args:
        path: a MED file with one mesh and fields on it.
        names: the wanted fields, or None for all.

    Raises:
        ValueError: the file is no MED file or a damaged one, lacks a wanted field, or a field
            changes its places in time.
        FileNotFoundError: there is no such file.
    """
    found = _field_names(path)
    missing = [name for name in names or () if name not in found]
    if missing:
        raise ValueError(
            f"{path}: found no field {', '.join(missing)}; it has {', '.join(found) or 'no fields'}"
        )
    try:
        series = mc.MEDFileFields(str(path))
        mesh = mc.MEDFileUMesh(str(path))
        fields = (
            _field(path, mesh, series.getFieldWithName(name))
            for name in (found if names is None else names)
        )
        return {item.name: item for item in fields if item is not None}
    except mc.InterpKernelException as error:
        raise ValueError(f"{path}: its fields cannot be read ({error.what()})") from error


def _field_names(path: Path) -> list[str]:
    try:
        # h5py refuses a damaged file without a word; medcoupling floods the terminal first.
        with h5py.File(path) as hdf:
            if len(hdf["ENS_MAA"]) != 1:
                raise ValueError(f"{path}: one mesh is expected, found {len(hdf['ENS_MAA'])}")
            return list(hdf.get("CHA", ()))
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, KeyError) as error:
        raise ValueError(f"{path}: not a MED file, or a damaged one") from error


def _field(path: Path, mesh: Any, series: Any) -> MedField | None:
    places = series[0].getTypesOfFieldAvailable()
    place = next((place for place, kind in _KINDS.items() if kind in places), None)
    if place is None or (place != "nodes" and _VOLUME_CELLS not in _levels(mesh, series[0])):
        return None
    name, steps = series.getName(), series.getTimeSteps()
    values, ids = [], None
    for index in range(len(steps)):
        array, profile = series[index].getFieldWithProfile(_KINDS[place], _VOLUME_CELLS, mesh)
        here = profile.toNumPyArray().astype(np.int64)
        if ids is not None and not np.array_equal(here, ids):
            raise ValueError(f"{path}: field {name} has values at other {place} at other instants")
        ids = here
        values.append(array.toNumPyArray().reshape(here.size, -1, len(series.getInfo())))
    stacked = np.array(values)
    info = mc.DataArrayDouble(1, len(series.getInfo()))
    info.setInfoOnComponents(list(series.getInfo()))
    return MedField(
        name=name,
        place=place,
        components=tuple(v.strip() for v in info.getVarsOnComponent()),
        units=tuple(unit.strip() for unit in info.getUnitsOnComponent()),
        times=np.array([time for _, _, time in steps]),
        values=stacked if place == "points" else stacked[:, :, 0],
        ids=np.asarray(ids),
    )


def _levels(mesh: Any, step: Any) -> list[int]:
    levels: list[int] = step.getNonEmptyLevels(mesh.getName())[1]
    return levels

"""Fields over time in MED files: at nodes, in cells and at the Gauss points of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import medcoupling as mc
import numpy as np
from numpy.typing import NDArray

from meshes.med_file import MedFile, open_med

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
        weights: of the Gauss points in the reference cell, shape (n_gauss,), else empty.
    """

    name: str
    place: Place
    components: tuple[str, ...]
    units: tuple[str, ...]
    times: FloatArray
    values: FloatArray
    ids: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    weights: FloatArray = field(default_factory=lambda: np.zeros(0))


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
    file = open_med(path)
    missing = [name for name in names or () if name not in file.fields]
    if missing:
        raise ValueError(
            f"{path}: found no field {', '.join(missing)}; it has "
            f"{', '.join(file.fields) or 'no fields'}"
        )
    fields = (read_med_field(file, name) for name in (file.fields if names is None else names))
    return {item.name: item for item in fields if item is not None}


def read_med_field(file: MedFile, name: str) -> MedField | None:
    """A field of an open file at all its instants, see `read_med_fields`; None if it is of faces.

    Raises:
        ValueError: the field is damaged, or changes its places in time.
    """
    try:
        return _field(file.path, file.mesh, mc.MEDFileFieldMultiTS(str(file.path), name))
    except mc.InterpKernelException as error:
        raise ValueError(
            f"{file.path}: its field {name} cannot be read ({error.what()})"
        ) from error


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
        weights=_weights(mesh, series[0]) if place == "points" else np.zeros(0),
    )


def _weights(mesh: Any, step: Any) -> FloatArray:
    """Weights of the Gauss points in the reference cell, shape (n_gauss,)."""
    found = step.getFieldOnMeshAtLevel(mc.ON_GAUSS_PT, _VOLUME_CELLS, mesh)
    return np.array(found.getGaussLocalization(0).getWeights())


def _levels(mesh: Any, step: Any) -> list[int]:
    levels: list[int] = step.getNonEmptyLevels(mesh.getName())[1]
    return levels

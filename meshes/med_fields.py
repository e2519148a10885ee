"""Fields over time in MED files: at nodes, in cells, at the Gauss points or nodes of cells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import medcoupling as mc
import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.med_file import MedFile, as_utf8, open_med, quiet_library, write_as_med_4_0

Place = Literal["nodes", "cells", "points", "cell nodes"]

_KINDS: dict[Place, int] = {
    "nodes": mc.ON_NODES,
    "cells": mc.ON_CELLS,
    "points": mc.ON_GAUSS_PT,
    "cell nodes": mc.ON_GAUSS_NE,
}
_SEVERAL_IN_A_CELL: tuple[Place, ...] = ("points", "cell nodes")
_VOLUME_CELLS = 0  # level of a MED mesh, relative to its dimension


@dataclass(frozen=True, eq=False)
class MedField:
    """A field over time.

    Attributes:
        name: name of the field.
        place: where its values are: nodes, cells, the Gauss points of cells, or the nodes as each
            cell has them.
        components: name of each of the k components.
        units: unit of each, empty where the file states none.
        times: instants [s], shape (T,).
        values: shape (T, n, k), of Gauss points (T, n, n_gauss, k), of the nodes of cells
            (T, n, nodes of a cell, k) in MED's order.
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
    mesh = mc.MEDFileUMesh(as_utf8(path))
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
        write_as_med_4_0(series, path, replace=False)


def _instant(item: MedField, step: int, support: Any) -> Any:
    array = mc.DataArrayDouble(np.ascontiguousarray(item.values[step], dtype=np.float64))
    named = zip(item.components, item.units, strict=True)
    array.setInfoOnComponents([f"{name} [{unit}]" if unit else name for name, unit in named])
    instant = mc.MEDCouplingFieldDouble(_KINDS[item.place], mc.ONE_TIME)
    instant.setName(item.name)
    instant.setMesh(support)
    instant.setArray(array)
    instant.setTime(float(item.times[step]), step, -1)
    instant.setTimeUnit("s")
    return instant


def read_med_fields(
    path: Path, names: Sequence[str] | None = None, mesh: str | None = None
) -> dict[str, MedField]:
    """Fields of a MED file by name, at all their instants.

    Cells are those of the highest dimension; fields of their faces and edges are left out. A
    field with values at several places (nodes and cells) counts as that of the first of nodes,
    cells, points, nodes of cells. Whole numbers are read as the same real ones.

    Args:
        path: a MED file with fields.
        names: the wanted fields, or None for all on the mesh.
        mesh: name of the mesh; None for the only one, or of several for the only one that has
            the wanted fields.

    Raises:
        ValueError: the file cannot be read, see `open_med`, or lacks a wanted field; or a field
            cannot, see `read_med_field`.
        FileNotFoundError: there is no such file.
    """
    file = open_med(path, mesh, fields=names or ())
    missing = [name for name in names or () if name not in file.fields]
    if missing:
        raise ValueError(
            f"{path}: found no field {', '.join(missing)}; it has "
            f"{', '.join(file.fields) or 'no fields'}"
        )
    read = {name: read_med_field(file, name) for name in (names or file.fields)}
    absent = [name for name, item in read.items() if item is None]
    if names is not None and absent:
        raise ValueError(
            f"{path}: found the fields {', '.join(absent)} on faces or edges alone, expected "
            "values at nodes or in cells"
        )
    return {name: item for name, item in read.items() if item is not None}


def read_med_field(file: MedFile, name: str) -> MedField | None:
    """Read a field of an open file at all instants, see `read_med_fields`; None of faces.

    Raises:
        ValueError: the field is damaged, changes its places in time, or has different points in
            different cells.
    """
    try:
        with quiet_library():
            series = mc.MEDFileAnyTypeFieldMultiTS.New(str(file.path), name)
        return _field(file.path, file.mesh, series)
    except mc.InterpKernelException as error:
        raise ValueError(
            f"{file.path}: its field {name} cannot be read ({error.what()})"
        ) from error


@dataclass(frozen=True)
class _Support:
    """Where the values of an instant are.

    Attributes:
        place: the first that it has, None where it has none.
        points: names of the kinds of points in a cell: sets of Gauss points, or kinds of cells.
    """

    place: Place | None
    points: tuple[str, ...]


def _field(path: Path, mesh: Any, series: Any) -> MedField | None:
    name, steps = series.getName(), series.getTimeSteps()
    supports = [_support(mesh, series[index]) for index in range(len(steps))]
    place, points = supports[0].place, supports[0].points
    if any(support != supports[0] for support in supports):
        raise ValueError(f"{path}: field {name} has values at other places at other instants")
    if len(points) > 1:
        raise ValueError(
            f"{path}: field {name} has values at several kinds of {place}, {', '.join(points)}; "
            "expected one kind in all cells"
        )
    if place is None:
        return None
    values: list[FloatArray] = []
    ids = np.zeros(0, dtype=np.int64)
    for index in range(len(steps)):
        array, profile = series[index].getFieldWithProfile(_KINDS[place], _VOLUME_CELLS, mesh)
        cells = profile.toNumPyArray().astype(np.int64)
        block = array.toNumPyArray().reshape(cells.size, -1, len(series.getInfo()))
        if values and not (np.array_equal(cells, ids) and block.shape == values[0].shape):
            raise ValueError(f"{path}: field {name} has values at other {place} at other instants")
        ids = cells
        values.append(block)
    stacked = np.array(values, dtype=np.float64)
    info = mc.DataArrayDouble(1, len(series.getInfo()))
    info.setInfoOnComponents(list(series.getInfo()))
    weights = series[0].getLocalization(points[0]).getGaussWeights() if place == "points" else ()
    return MedField(
        name=name,
        place=place,
        components=tuple(v.strip() for v in info.getVarsOnComponent()),
        units=tuple(unit.strip() for unit in info.getUnitsOnComponent()),
        times=np.array([time for _, _, time in steps]),
        values=stacked if place in _SEVERAL_IN_A_CELL else stacked[:, :, 0],
        ids=ids,
        weights=np.array(weights, dtype=np.float64),
    )


def _support(mesh: Any, step: Any) -> _Support:
    cells = mesh.getGeoTypesAtLevel(_VOLUME_CELLS)
    parts = [
        (kind, place, points)
        for kind, places in step.getFieldSplitedByType()
        for place, _, _, points in places
        if place == mc.ON_NODES or kind in cells
    ]
    found = {place for _, place, _ in parts}
    place = next((place for place, number in _KINDS.items() if number in found), None)
    if place not in _SEVERAL_IN_A_CELL:
        return _Support(place, ())
    kinds = {
        points
        if place == "points"
        else mc.MEDCouplingMesh.GetReprOfGeometricType(kind).removeprefix("NORM_")
        for kind, number, points in parts
        if number == _KINDS[place]
    }
    return _Support(place, tuple(sorted(kinds)))

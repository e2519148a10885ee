"""Fields of a .rmed file of Code_Aster by name and instant."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.med_fields import Place, read_med_field
from meshes.med_file import open_med
from meshes.prism_mesh import PrismMesh
from meshes.tet10 import MIRRORED
from solver_adapters.result_files import ResultFileError

# The name of a field is that of its concept, padded to eight signs, and its own: U_______DEPL.
_CONCEPT, _PADDING = 8, "_ "
_CELLS = 0  # level of a MED mesh, relative to its dimension
_SAME_INSTANT = 1e-6  # of the time, as Code_Aster compares instants
_SAME_PLACE = 1e-6  # µm
_OWNERS: dict[Place, str] = {"nodes": "nodes", "points": "cells"}


@dataclass(frozen=True, eq=False)
class Field:
    """A field at some instants.

    Attributes:
        components: their names.
        values: at the nodes, shape (n_instants, n_nodes, n_components), or at the Gauss points,
            shape (n_instants, n_cells, n_gauss, n_components).
        weights: of the Gauss points in the reference cell, shape (n_gauss,), or None.
    """

    components: tuple[str, ...]
    values: FloatArray
    weights: FloatArray | None = None

    def pick(self, *names: str) -> FloatArray:
        """Return the components of these names, in this order."""
        return self.values[..., [self.components.index(name) for name in names]]


class ResultFile:
    """A .rmed file that is whole and holds one mesh.

    Attributes:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        """Open a file.

        Raises:
            ResultFileError: it is missing, empty, truncated or no MED file with fields.
        """
        self.path = path
        try:
            self._file = open_med(path)
        except (ValueError, FileNotFoundError) as error:
            raise ResultFileError(f"{error}; expected the fields that IMPR_RESU writes") from None

    def require_mesh(self, mesh: PrismMesh) -> None:
        """Make sure that the fields belong to a mesh.

        Raises:
            ResultFileError: the nodes or cells are others.
        """
        points = self._file.mesh.getCoords().toNumPyArray()
        if _CELLS not in self._file.mesh.getNonEmptyLevels():
            found = f"a mesh of {len(points)} nodes without cells"
            raise ResultFileError(
                f"{self.path}: found {found}, expected the {len(mesh.cells)} of the simulation"
            )
        cells = self._file.mesh.getMeshAtLevel(_CELLS)
        if points.shape != mesh.points.shape or cells.getNumberOfCells() != len(mesh.cells):
            raise ResultFileError(
                f"{self.path}: found a mesh of {len(points)} nodes and {cells.getNumberOfCells()} "
                f"cells, expected the {len(mesh.points)} nodes and {len(mesh.cells)} cells of the "
                "simulation"
            )
        flat = cells.getNodalConnectivity().toNumPyArray()
        same_cells = flat.size == 11 * len(mesh.cells) and np.array_equal(
            flat.reshape(-1, 11)[:, 1:], mesh.cells[:, MIRRORED]
        )
        if not same_cells or abs(points - mesh.points).max() > _SAME_PLACE:
            raise ResultFileError(
                f"{self.path}: found nodes or cells in other places than those of the simulation; "
                "expected the result of its own job"
            )

    def nodal(self, name: str, instants: FloatArray) -> Field:
        """Return a field at the nodes.

        Args:
            name: name in Code_Aster, as DEPL.
            instants: wanted times [s], shape (n_instants,).

        Raises:
            ResultFileError: the field or an instant is missing, or the field is incomplete.
        """
        return self._field(name, instants, "nodes", self._file.mesh.getNumberOfNodes())

    def at_gauss_points(self, name: str, instants: FloatArray) -> Field:
        """Return a field at the Gauss points of the cells, all of one kind.

        Args:
            name: name in Code_Aster, as SIEF_ELGA.
            instants: wanted times [s], shape (n_instants,).

        Raises:
            ResultFileError: the field or an instant is missing, or the field is incomplete.
        """
        n_cells = self._file.mesh.getMeshAtLevel(_CELLS).getNumberOfCells()
        return self._field(name, instants, "points", n_cells)

    def _field(self, name: str, instants: FloatArray, place: Place, count: int) -> Field:
        full = self._full_name(name)
        try:
            found = read_med_field(self._file, full)
        except ValueError as error:
            raise ResultFileError(f"{error}; expected what IMPR_RESU writes") from error
        if found is None or found.place != place:
            raise ResultFileError(
                f"{self.path}: the field {name} has values at "
                f"{'faces' if found is None else found.place}, expected them at {place}"
            )
        if not np.array_equal(found.ids, np.arange(count)):
            raise ResultFileError(
                f"{self.path}: the field {name} has values for {found.ids.size} {_OWNERS[place]}, "
                f"expected them for each of {count}"
            )
        rows = self._rows(name, found.times, instants)
        weights = found.weights if place == "points" else None
        return Field(found.components, found.values[rows], weights)

    def _full_name(self, name: str) -> str:
        for full in self._file.fields:
            if name in (full, full[_CONCEPT:].rstrip(_PADDING)):
                return full
        raise ResultFileError(
            f"{self.path}: found the fields {', '.join(self._file.fields) or 'none'}, expected "
            f"{name}"
        )

    def _rows(self, name: str, times: FloatArray, instants: FloatArray) -> IntArray:
        """Return the row of each instant in the file."""
        gap = abs(times - instants[:, None])
        late = gap.min(axis=1) > _SAME_INSTANT * np.maximum(1.0, abs(instants))
        if late.any():
            raise ResultFileError(
                f"{self.path}: the field {name} has {len(times)} instants from {times.min():g} to "
                f"{times.max():g} s; expected {instants[late][0]:g} s and {late.sum() - 1} others "
                "too"
            )
        return np.asarray(gap.argmin(axis=1))

"""Fields of a .rmed file of Code_Aster by name and instant, read with medcoupling."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc
import numpy as np

from meshes.prism_mesh import PrismMesh
from meshes.tet10 import MIRRORED
from solver_adapters.interface import FloatArray, IntArray
from solver_adapters.result_files import ResultFileError

# Code_Aster pads names of fields: U_______DEPL.
_SEPARATOR = "_"
_SAME_INSTANT = 1e-6  # of the time, as Code_Aster compares instants
_SAME_PLACE = 1e-6  # µm


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
        """The components of these names, in this order."""
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
        if not path.is_file():
            raise ResultFileError(
                f"{path}: no such file; expected the fields that Code_Aster writes as it ends"
            )
        if not path.stat().st_size:
            raise ResultFileError(f"{path}: the file is empty; expected fields of Code_Aster")
        try:
            # h5py refuses a damaged file without a word; medcoupling floods the terminal first.
            with h5py.File(path) as file:
                self._fields = tuple(file["CHA"])
                meshes = len(file["ENS_MAA"])
        except (OSError, KeyError, RuntimeError) as error:
            raise ResultFileError(
                f"{path}: not a MED file with fields, or a truncated one; expected what IMPR_RESU "
                "writes"
            ) from error
        if meshes != 1:
            raise ResultFileError(f"{path}: found {meshes} meshes, expected one")
        self._mesh = self._load(mc.MEDFileUMesh, str(path))

    def require_mesh(self, mesh: PrismMesh) -> None:
        """Make sure that the fields belong to a mesh.

        Raises:
            ResultFileError: the nodes or cells are others.
        """
        points = self._mesh.getCoords().toNumPyArray()
        cells = self._mesh.getMeshAtLevel(0)
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
        """A field at the nodes.

        Args:
            name: name in Code_Aster, as DEPL.
            instants: wanted times [s], shape (n_instants,).

        Raises:
            ResultFileError: the field or an instant is missing, or the field is incomplete.
        """
        series = self._series(name)
        arrays = [
            series.getTimeStep(*step).getUndergroundDataArray()
            for step in self._steps(series, name, instants)
        ]
        expected = len(self._mesh.getCoords())
        values = np.array([array.toNumPyArray() for array in arrays])
        if values.shape[1] != expected:
            raise ResultFileError(
                f"{self.path}: the field {name} has {values.shape[1]} values, expected one for "
                f"each of {expected} nodes"
            )
        return Field(_components(arrays[0]), values)

    def at_gauss_points(self, name: str, instants: FloatArray) -> Field:
        """A field at the Gauss points of the cells, all of one kind.

        Args:
            name: name in Code_Aster, as SIEF_ELGA.
            instants: wanted times [s], shape (n_instants,).

        Raises:
            ResultFileError: the field or an instant is missing, or the field is incomplete.
        """
        series = self._series(name)
        fields = [
            series.getTimeStep(*step).getFieldOnMeshAtLevel(mc.ON_GAUSS_PT, 0, self._mesh)
            for step in self._steps(series, name, instants)
        ]
        weights = np.array(fields[0].getGaussLocalization(0).getWeights())
        n_cells = self._mesh.getMeshAtLevel(0).getNumberOfCells()
        arrays = [field.getArray() for field in fields]
        values = np.array([array.toNumPyArray() for array in arrays])
        if values.shape[1] != n_cells * len(weights):
            raise ResultFileError(
                f"{self.path}: the field {name} has {values.shape[1]} values, expected "
                f"{len(weights)} for each of {n_cells} cells"
            )
        shape = (len(instants), n_cells, len(weights), values.shape[-1])
        return Field(_components(arrays[0]), values.reshape(shape), weights)

    def _series(self, name: str) -> Any:
        for full in self._fields:
            if full == name or full.endswith(_SEPARATOR + name):
                return self._load(mc.MEDFileFieldMultiTS, str(self.path), full)
        raise ResultFileError(
            f"{self.path}: found the fields {', '.join(self._fields) or 'none'}, expected {name}"
        )

    def _steps(self, series: Any, name: str, instants: FloatArray) -> list[IntArray]:
        """Iteration and order of the step of each instant."""
        steps = series.getTimeSteps()
        times = np.array([time for _, _, time in steps])
        gap = abs(times - instants[:, None])
        late = gap.min(axis=1) > _SAME_INSTANT * np.maximum(1.0, abs(instants))
        if late.any():
            raise ResultFileError(
                f"{self.path}: the field {name} has {len(times)} instants from {times.min():g} to "
                f"{times.max():g} s; expected {instants[late][0]:g} s and {late.sum() - 1} others "
                "too"
            )
        return [steps[index][:2] for index in gap.argmin(axis=1)]

    def _load(self, kind: Any, *arguments: str) -> Any:
        try:
            return kind(*arguments)
        except mc.InterpKernelException as error:
            raise ResultFileError(
                f"{self.path}: medcoupling cannot read it; expected what IMPR_RESU writes"
            ) from error


def _components(array: Any) -> tuple[str, ...]:
    # "DX [um]" where a unit is given.
    return tuple(info.split("[")[0].strip() for info in array.getInfoOnComponents())

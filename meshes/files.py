"""Mesh files: MED (Salome, Code_Aster) both ways, VTU for ParaView."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5py
import medcoupling as mc
import meshio
import numpy as np
from numpy.typing import NDArray

from meshes.cells import inverted_cells
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.tet10 import MIRRORED, node_groups

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_CELLS, _FACES, _NODES = 0, -1, 1  # levels of a MED mesh, relative to its dimension


def write_med(mesh: PrismMesh, path: Path) -> None:
    """Write the mesh, named `prism`, with all its groups.

    Groups of cells: GRAIN1, GRAIN2, …; of faces (where the mesh has them): S_PLUS, S_MINUS, TOP;
    of nodes: every group of `mesh.nodes`. MED's tetrahedra have the opposite handedness of
    VTK's, so their nodes are reordered.

    Args:
        mesh: the prism.
        path: file to write; an existing one is replaced.

    Raises:
        ValueError: the cells are no tet10.
    """
    _require_tet10(mesh, path)
    coordinates = mc.DataArrayDouble(np.ascontiguousarray(mesh.points))
    coordinates.setInfoOnComponents(["X [um]", "Y [um]", "Z [um]"])
    file = mc.MEDFileUMesh()
    file.setCoords(coordinates)
    cells = mesh.cells[:, MIRRORED]
    file.setMeshAtLevel(_CELLS, _med_cells("prism", 3, mc.NORM_TETRA10, coordinates, cells))
    members: dict[str, IntArray] = {}
    if mesh.faces:
        faces = np.concatenate([mesh.faces[name] for name in FACE_GROUPS])
        file.setMeshAtLevel(_FACES, _med_cells("prism", 2, mc.NORM_TRI6, coordinates, faces))
        ends = np.cumsum([len(mesh.faces[name]) for name in FACE_GROUPS])
        members = dict(zip(FACE_GROUPS, np.split(np.arange(len(faces)), ends), strict=False))
    file.setName("prism")

    for grain in range(mesh.n_grains):
        file.addGroup(_CELLS, _group(f"GRAIN{grain + 1}", np.flatnonzero(mesh.grain == grain)))
    for name, ids in members.items():
        file.addGroup(_FACES, _group(name, ids))
    for name, ids in mesh.nodes.items():
        file.addGroup(_NODES, _group(name, ids))
    file.write(str(path), 2)  # 2: replace the file


def read_med(path: Path) -> PrismMesh:
    """Read a prism of tet10 cells with the groups GRAIN1, …, S_PLUS, S_MINUS and TOP.

    The node groups follow from the faces. Cells of either handedness are accepted.

    Args:
        path: a MED file that holds one mesh, in µm.

    Returns:
        the mesh, every Jacobian positive.

    Raises:
        ValueError: the file is no MED mesh, lacks groups, has other cells than tet10, inverted
            ones, a cell in no grain or in two, or a node in no cell.
        FileNotFoundError: there is no such file.
    """
    file = _open(path)
    _require_groups(path, file)
    levels = ((_CELLS, mc.NORM_TETRA10, "tet10"), (_FACES, mc.NORM_TRI6, "tri6"))
    for level, kind, name in levels:
        if file.getGeoTypesAtLevel(level) != [kind]:
            raise ValueError(f"{path}: quadratic cells are expected ({name} and nothing else)")
    points = file.getCoords().toNumPyArray().astype(np.float64).reshape(-1, 3)
    cells = _connectivity(file, _CELLS, mc.NORM_TETRA10)[:, MIRRORED]
    # Some writers leave tetrahedra in VTK order.
    corner = points[cells[:, :4]]
    left_handed = np.linalg.det(corner[:, 1:] - corner[:, :1]) < 0
    cells[left_handed] = cells[left_handed][:, MIRRORED]
    inverted = inverted_cells(points, cells)
    if len(inverted):
        raise ValueError(f"{path}: {len(inverted)} of {len(cells)} cells have a Jacobian ≤ 0")
    loose = len(points) - len(np.unique(cells))
    if loose:
        raise ValueError(f"{path}: {loose} of {len(points)} nodes belong to no cell")
    all_faces = _connectivity(file, _FACES, mc.NORM_TRI6)
    faces = {name: all_faces[_members(file, _FACES, name)] for name in FACE_GROUPS}
    return PrismMesh(points, cells, _grains(path, file), faces, node_groups(points, faces))


def write_vtu(
    mesh: PrismMesh,
    path: Path,
    point_data: Mapping[str, FloatArray] | None = None,
    cell_data: Mapping[str, FloatArray] | None = None,
) -> None:
    """Write the cells for ParaView, with `grain` (1, 2, …) as cell data.

    Args:
        mesh: the prism.
        path: file to write, ending in .vtu.
        point_data: nodal fields, each of shape (n_nodes,) or (n_nodes, k).
        cell_data: cell fields, each of shape (n_cells,) or (n_cells, k).

    Raises:
        ValueError: the cells are no tet10.
    """
    _require_tet10(mesh, path)
    fields = {"grain": mesh.grain + 1, **(cell_data or {})}
    meshio.Mesh(
        mesh.points,
        [("tetra10", mesh.cells)],
        point_data=dict(point_data or {}),
        cell_data={name: [values] for name, values in fields.items()},
    ).write(path, file_format="vtu")


def _require_tet10(mesh: PrismMesh, path: Path) -> None:
    if mesh.cells.shape[1] != 10:
        raise ValueError(f"{path}: only tet10 meshes can be written; this one is of wedge15 cells")


def _med_cells(
    name: str, dimension: int, kind: int, coordinates: Any, connectivity: IntArray
) -> Any:
    mesh = mc.MEDCoupling1SGTUMesh(name, kind)
    mesh.setCoords(coordinates)
    mesh.setNodalConnectivity(mc.DataArrayInt64(np.ascontiguousarray(connectivity).ravel()))
    return mesh.buildUnstructured()


def _group(name: str, ids: IntArray) -> Any:
    array = mc.DataArrayInt64(np.ascontiguousarray(ids, dtype=np.int64))
    array.setName(name)
    return array


def _open(path: Path) -> Any:
    try:
        # h5py refuses a damaged file without a word; medcoupling floods the terminal first.
        with h5py.File(path) as hdf:
            meshes = list(hdf["ENS_MAA"])
        if len(meshes) != 1:
            raise ValueError(f"{path}: one mesh is expected, found {len(meshes)}: {meshes}")
        return mc.MEDFileUMesh(str(path))
    except FileNotFoundError:
        raise FileNotFoundError(f"{path}: no such file") from None
    except (OSError, KeyError, mc.InterpKernelException) as error:
        raise ValueError(f"{path}: not a MED mesh file, or a damaged one") from error


def _require_groups(path: Path, file: Any) -> None:
    found = {level: _groups(file, level) for level in (_CELLS, _FACES)}
    missing = [name for name in FACE_GROUPS if name not in found[_FACES]]
    if "GRAIN1" not in found[_CELLS]:
        missing.insert(0, "GRAIN1")
    if missing:
        raise ValueError(
            f"{path}: missing groups {', '.join(missing)}; the file has "
            f"{', '.join(found[_CELLS] + found[_FACES]) or 'no groups of cells or faces'}"
        )


def _groups(file: Any, level: int) -> list[str]:
    if level not in file.getNonEmptyLevels():
        return []
    return sorted(file.getGroupsOnSpecifiedLev(level))


def _connectivity(file: Any, level: int, kind: int) -> IntArray:
    """Node indices of the cells of a level that has one kind only, shape (n, nodes of it)."""
    single = file.getDirectUndergroundSingleGeoTypeMesh(kind)
    flat: IntArray = single.getNodalConnectivity().toNumPyArray().astype(np.int64)
    return flat.reshape(file.getMeshAtLevel(level).getNumberOfCells(), -1)


def _members(file: Any, level: int, name: str) -> IntArray:
    members: IntArray = file.getGroupArr(level, name).toNumPyArray().astype(np.int64)
    return members


def _grains(path: Path, file: Any) -> IntArray:
    """Index of the grain of each cell, from its group GRAIN1, GRAIN2, …, shape (n_cells,)."""
    n_cells = file.getMeshAtLevel(_CELLS).getNumberOfCells()
    names = [name for name in _groups(file, _CELLS) if name.startswith("GRAIN")]
    counted = np.zeros(n_cells, dtype=np.int64)
    grain = np.zeros(n_cells, dtype=np.int64)
    for name in names:
        number = name.removeprefix("GRAIN")
        if not number.isdigit() or not 1 <= int(number) <= len(names):
            raise ValueError(f"{path}: grains are expected as GRAIN1, GRAIN2, …, found {names}")
        members = _members(file, _CELLS, name)
        grain[members] = int(number) - 1
        counted[members] += 1
    if (counted != 1).any():
        raise ValueError(
            f"{path}: {int((counted != 1).sum())} of {n_cells} cells are in no grain or in two"
        )
    return grain

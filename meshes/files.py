"""Mesh files: MED (Salome, Code_Aster) both ways, VTU for ParaView."""

from __future__ import annotations

import os
import pwd
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import medcoupling as mc
import meshio
import numpy as np

from meshes import hex20, tet10
from meshes.arrays import FloatArray, IntArray
from meshes.cells import inverted_cells, jacobians, outer_faces
from meshes.med_file import open_med, write_as_med_4_0
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.tet10 import node_groups

_CELLS, _FACES, _NODES = 0, -1, 1  # levels of a MED mesh, relative to its dimension
_FIRST_GRAIN = "GRAIN1"


@dataclass(frozen=True, eq=False)
class _Kind:
    """A kind of cell in the files.

    Attributes:
        med: its number in MED.
        face: that of its faces.
        mirrored: its nodes in MED's order.
        vtu: its name in meshio, whose order of nodes is VTK's.
    """

    med: int
    face: int
    mirrored: IntArray
    vtu: str


_KINDS = {
    10: _Kind(mc.NORM_TETRA10, mc.NORM_TRI6, tet10.MIRRORED, "tetra10"),
    20: _Kind(mc.NORM_HEXA20, mc.NORM_QUAD8, hex20.MIRRORED, "hexahedron20"),
}


def write_med(mesh: PrismMesh, path: Path) -> None:
    """Write the mesh, named `prism`, with all its groups, in MED 4.0.

    Programs with MED 4.0 or 4.1 (Code_Aster 15 to 17) refuse newer files.

    Groups of cells: GRAIN1, GRAIN2, …; of faces (where the mesh has them): S_PLUS, S_MINUS, TOP;
    of nodes: every group of `mesh.nodes`. MED's cells have the opposite handedness of VTK's, so
    their nodes are reordered.

    Args:
        mesh: the prism.
        path: file to write; an existing one is replaced.
    """
    kind = _KINDS[mesh.cells.shape[1]]
    coordinates = mc.DataArrayDouble(np.ascontiguousarray(mesh.points))
    coordinates.setInfoOnComponents(["X [um]", "Y [um]", "Z [um]"])
    file = mc.MEDFileUMesh()
    file.setCoords(coordinates)
    cells = mesh.cells[:, kind.mirrored]
    file.setMeshAtLevel(_CELLS, _med_cells("prism", 3, kind.med, coordinates, cells))
    members: dict[str, IntArray] = {}
    if mesh.faces:
        faces = [
            _med_cells("prism", 2, kind.face, coordinates, mesh.faces[name]) for name in FACE_GROUPS
        ]
        all_faces = mc.MEDCouplingUMesh.MergeUMeshesOnSameCoords(faces)
        all_faces.setName("prism")
        file.setMeshAtLevel(_FACES, all_faces)
        ends = np.cumsum([len(mesh.faces[name]) for name in FACE_GROUPS])
        members = dict(zip(FACE_GROUPS, np.split(np.arange(ends[-1]), ends), strict=False))
    file.setName("prism")

    grains = {f"GRAIN{k + 1}": np.flatnonzero(mesh.grain == k) for k in range(mesh.n_grains)}
    for level, groups in ((_CELLS, grains), (_FACES, members), (_NODES, mesh.nodes)):
        # All groups of a level at once: one by one they leave members of none in a family that
        # the file does not declare.
        if groups:
            file.setGroupsAtLevel(level, [_group(name, ids) for name, ids in groups.items()])
    # The library refuses to write it for a user without a name.
    file.setUnivNameWrStatus(_has_name())
    write_as_med_4_0(file, path, replace=True)


def _has_name() -> bool:
    """Whether the user of this process has an entry in the table of users."""
    try:
        pwd.getpwuid(os.geteuid())
    except KeyError:
        return False
    return True


def read_med(path: Path, mesh: str | None = None) -> PrismMesh:
    """Read a prism of tet10 or hex20 cells with groups GRAIN1, …, S_PLUS, S_MINUS and TOP.

    The node groups follow from the faces. Cells of either handedness are accepted. A group of
    nodes stands for the outer faces between them where there is none of faces.

    Args:
        path: a MED file, in µm.
        mesh: name of the mesh; None for the only one, or of several for the only one that has
            these groups.

    Returns:
        the mesh, every Jacobian positive.

    Raises:
        ValueError: the file cannot be read, see `open_med`, lacks groups, has other cells than
            tet10 or hex20, inverted ones, a cell in no grain or in two, or a node in no cell.
        FileNotFoundError: there is no such file.
    """
    file = open_med(path, mesh, groups=(_FIRST_GRAIN, *FACE_GROUPS)).mesh
    _require_groups(path, file)
    kind = _kind(path, file)
    points = file.getCoords().toNumPyArray().astype(np.float64).reshape(-1, 3)
    cells = _connectivity(file, kind.med)[:, kind.mirrored]
    _refuse_other_nodes(path, "cells", cells, len(points))
    # Some writers leave cells in VTK order.
    left_handed = jacobians(points, cells)[:, -1] < 0
    cells[left_handed] = cells[left_handed][:, kind.mirrored]
    inverted = inverted_cells(points, cells)
    if len(inverted):
        raise ValueError(f"{path}: {len(inverted)} of {len(cells)} cells have a Jacobian ≤ 0")
    loose = len(points) - len(np.unique(cells))
    if loose:
        raise ValueError(f"{path}: {loose} of {len(points)} nodes belong to no cell")
    faces = {name: _faces(path, file, name, kind, cells) for name in FACE_GROUPS}
    for name, nodes in faces.items():
        _refuse_other_nodes(path, f"faces of {name}", nodes, len(points))
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
    """
    fields = {"grain": mesh.grain + 1, **(cell_data or {})}
    meshio.Mesh(
        mesh.points,
        [(_KINDS[mesh.cells.shape[1]].vtu, mesh.cells)],
        point_data=dict(point_data or {}),
        cell_data={name: [values] for name, values in fields.items()},
    ).write(path, file_format="vtu")


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


def _require_groups(path: Path, file: Any) -> None:
    cells, faces, nodes = (_groups(file, level) for level in (_CELLS, _FACES, _NODES))
    missing = [name for name in FACE_GROUPS if name not in faces + nodes]
    if _FIRST_GRAIN not in cells:
        missing.insert(0, _FIRST_GRAIN)
    if missing:
        raise ValueError(
            f"{path}: missing groups {', '.join(missing)}; the file has "
            f"{', '.join(cells) or 'none'} of cells, {', '.join(faces) or 'none'} of faces and "
            f"{', '.join(nodes) or 'none'} of nodes"
        )


def _groups(file: Any, level: int) -> list[str]:
    if level not in file.getNonEmptyLevelsExt():
        return []
    return sorted(file.getGroupsOnSpecifiedLev(level))


def _kind(path: Path, file: Any) -> _Kind:
    """Return the kind of all cells of a file."""
    cells, faces = (_kinds(file, level) for level in (_CELLS, _FACES))
    for kind in _KINDS.values():
        if cells == [kind.med] and set(faces) <= {kind.face}:
            return kind
    raise ValueError(
        f"{path}: found cells {_names(cells)} with faces {_names(faces)}; quadratic cells are "
        "expected (TETRA10 with TRI6 faces, or HEXA20 with QUAD8 faces, and nothing else)"
    )


def _kinds(file: Any, level: int) -> list[int]:
    kinds: list[int] = file.getGeoTypesAtLevel(level) if level in file.getNonEmptyLevels() else []
    return kinds


def _names(kinds: list[int]) -> str:
    names = (mc.MEDCouplingMesh.GetReprOfGeometricType(kind) for kind in kinds)
    return " and ".join(name.removeprefix("NORM_") for name in names) or "of no kind"


def _refuse_other_nodes(path: Path, what: str, nodes: IntArray, n_points: int) -> None:
    if nodes.min() < 0 or nodes.max() >= n_points:
        found = f"{what} with the nodes {nodes.min() + 1} to {nodes.max() + 1}"
        raise ValueError(f"{path}: found {found}, expected 1 to {n_points}")


def _connectivity(file: Any, kind: int) -> IntArray:
    """Node indices of all cells of a kind, shape (n, nodes of it)."""
    single = file.getDirectUndergroundSingleGeoTypeMesh(kind)
    flat: IntArray = single.getNodalConnectivity().toNumPyArray().astype(np.int64)
    return flat.reshape(single.getNumberOfCells(), -1)


def _faces(path: Path, file: Any, name: str, kind: _Kind, cells: IntArray) -> IntArray:
    """Node indices of the faces of a group, shape (n, nodes of one)."""
    if name not in _groups(file, _FACES):
        return _faces_between(path, name, _members(file, _NODES, name), cells)
    members = _members(file, _FACES, name)
    if not members.size:
        raise ValueError(f"{path}: group {name} holds no face; expected one or more")
    return _connectivity(file, kind.face)[members]


def _faces_between(path: Path, name: str, nodes: IntArray, cells: IntArray) -> IntArray:
    """Outer faces with all corners among the nodes, shape (n, nodes of one)."""
    outer, _ = outer_faces(cells)
    faces = outer[np.isin(outer[:, : outer.shape[1] // 2], nodes).all(axis=1)]
    if len(faces):
        return faces
    raise ValueError(
        f"{path}: group {name} of {len(nodes)} nodes stands for no faces; expected a group of faces"
    )


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

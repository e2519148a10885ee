"""Volume meshes with named groups from the files of mesh generators: gmsh, MED, VTU."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sized
from dataclasses import dataclass
from pathlib import Path

import medcoupling as mc
import meshio
import numpy as np

from meshes.arrays import FloatArray, IntArray
from meshes.gmsh_reader import read_elsewhere
from meshes.guarded import can_be_read
from meshes.med_file import open_med
from meshes.plane_files import read_with_meshio
from meshes.prism_mesh import FACE_GROUPS

GRAIN = "GRAIN"
"""Beginning of the names of the groups of cells, which their numbers from 1 end."""
_FROM_VTU = "grain"  # array of numbers of grains, as `meshes.files.write_vtu` writes it
_NODES_OF_LEVEL = {"cells": 0, "faces": -1, "nodes": 1}  # of MED, relative to the dimension
_VOLUMES = ("tetra", "hexahedron", "wedge", "pyramid", "polyhedron")  # beginnings of kinds
_MED_KINDS = {
    mc.NORM_TETRA4: "tetra", mc.NORM_TETRA10: "tetra10", mc.NORM_HEXA8: "hexahedron",
    mc.NORM_HEXA20: "hexahedron20", mc.NORM_HEXA27: "hexahedron27",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class GroupedMesh:
    """The volume cells of a file, and its groups.

    Attributes:
        points: node coordinates, shape (n_nodes, 3).
        cells: by kind, as meshio names it, the nodes of each, corners first, of either handedness;
            shape (n, nodes of it), or (n, 0) of a kind that is not read.
        of_cells: indices of the cells of each group of cells, kinds one after the other.
        of_nodes: nodes of each group of faces or nodes.
    """

    points: FloatArray
    cells: Mapping[str, IntArray]
    of_cells: Mapping[str, IntArray]
    of_nodes: Mapping[str, IntArray]


def read_grouped(path: Path) -> GroupedMesh:
    """Read the volume cells of a mesh file with all its groups.

    Groups are physical groups in a file of gmsh, and groups of cells, faces or nodes in a MED file.
    A VTU file has an array `grain` of numbers from 1 of the cells, or arrays GRAIN1, GRAIN2, … of 0
    and 1, and arrays of 0 and 1 of faces or nodes.

    Args:
        path: a file of gmsh (.msh), MED (.med) or VTU (.vtu).

    Raises:
        ValueError: no such file, or none that can be read; what was found and what was expected,
            not where.
    """
    expected = "a mesh with named groups (.msh, .med or .vtu)"
    readers: Mapping[str, Callable[[Path], GroupedMesh | None]] = {
        ".msh": _read_msh, ".med": _read_med, ".vtu": _read_vtu,
    }  # fmt: skip
    read = readers.get(path.suffix.lower())
    if read is None:
        raise ValueError(f"found the ending {path.suffix or 'none'}, expected {expected}")
    if not path.is_file():
        raise ValueError(f"found no such file, expected {expected}")
    mesh = read(path)
    if mesh is None:
        kind = path.suffix.lower()
        raise ValueError(f"found no {kind} file that can be read, expected {expected}")
    return mesh


def _read_msh(path: Path) -> GroupedMesh | None:
    # On a damaged file gmsh may fail anywhere, or end the process.
    try:
        if not can_be_read("meshes.gmsh_reader:read_with_gmsh", path, "gmsh"):
            return None
        mesh = read_elsewhere(path, "gmsh")
    except Exception:
        return None
    sets = {
        name: [np.asarray(ids, dtype=np.int64) for ids in of_blocks]
        for name, of_blocks in mesh.cell_sets.items()
    }
    return _parted(mesh, sets, {})


def _read_vtu(path: Path) -> GroupedMesh | None:
    try:
        if not can_be_read("meshes.plane_files:read_with_meshio", path, "vtu"):
            return None
        mesh = read_with_meshio(path, "vtu")
    except (Exception, SystemExit):
        return None
    sets: dict[str, list[IntArray]] = {}
    for name, of_blocks in mesh.cell_data.items():
        values = [np.asarray(block) for block in of_blocks]
        if any(block.ndim != 1 for block in values):
            continue
        if name != _FROM_VTU:
            sets[name] = [np.flatnonzero(block) for block in values]
            continue
        numbers = np.unique(np.concatenate(values))
        for number in numbers[numbers > 0]:
            members = [np.flatnonzero(block == number) for block in values]
            sets.setdefault(f"{GRAIN}{number:g}", members)
    nodes = {
        name: np.flatnonzero(values)
        for name, values in mesh.point_data.items()
        if np.ndim(values) == 1
    }
    return _parted(mesh, sets, nodes)


def _parted(
    mesh: meshio.Mesh, sets: Mapping[str, list[IntArray]], nodes: Mapping[str, IntArray]
) -> GroupedMesh:
    """Part a mesh of blocks into volume cells, and what is left of their groups as nodes.

    Args:
        mesh: the mesh.
        sets: indices of the cells of each group, by its blocks.
        nodes: nodes of the groups of nodes.
    """
    cells: dict[str, list[IntArray]] = {}
    rows: list[tuple[int, str]] = []
    for number, block in enumerate(mesh.cells):
        name = block.type
        if name.startswith(_VOLUMES) and len(block.data):
            known = name in _MED_KINDS.values()
            found = np.asarray(block.data, dtype=np.int64) if known else _uncounted(block.data)
            cells.setdefault(name, []).append(found)
            rows.append((number, name))
    # Kinds one after the other, and the blocks of a kind in the order of the file.
    order = [number for kind in cells for number, name in rows if name == kind]
    counts = [len(mesh.cells[number].data) for number in order]
    starts = dict(zip(order, np.cumsum([0, *counts])[:-1], strict=True))
    of_cells: dict[str, IntArray] = {}
    of_nodes = {name: np.asarray(ids, dtype=np.int64) for name, ids in nodes.items()}
    for name, of_blocks in sets.items():
        inside = [of_blocks[number] + start for number, start in starts.items()]
        members = np.concatenate([np.zeros(0, dtype=np.int64), *inside])
        if members.size:
            of_cells[name] = members
        beside = [
            np.asarray(mesh.cells[number].data)[ids].ravel()
            for number, ids in enumerate(of_blocks)
            if number not in starts and len(ids)
        ]
        if beside:
            of_nodes[name] = np.unique(np.concatenate(beside).astype(np.int64))
    points = np.asarray(mesh.points, dtype=np.float64)
    return GroupedMesh(
        points, {kind: np.concatenate(parts) for kind, parts in cells.items()}, of_cells, of_nodes
    )


def _uncounted(cells: Sized) -> IntArray:
    """Return as many cells without a node."""
    return np.zeros((len(cells), 0), dtype=np.int64)


def _read_med(path: Path) -> GroupedMesh | None:
    try:
        file = open_med(path, groups=(f"{GRAIN}1", *FACE_GROUPS)).mesh
    except ValueError as error:
        raise ValueError(str(error).removeprefix(f"{path}: ")) from None
    try:
        points = file.getCoords().toNumPyArray().astype(np.float64)
        if file.getMeshDimension() != 3:
            return GroupedMesh(points, {}, {}, {})
        cells: dict[str, IntArray] = {}
        for kind in file.getGeoTypesAtLevel(0):
            single = file.getDirectUndergroundSingleGeoTypeMesh(kind)
            n_cells = single.getNumberOfCells()
            if kind in _MED_KINDS:
                nodes = single.getNodalConnectivity().toNumPyArray().astype(np.int64)
                cells[_MED_KINDS[kind]] = nodes.reshape(n_cells, -1)
            else:
                name = mc.MEDCouplingMesh.GetReprOfGeometricType(kind).removeprefix("NORM_")
                cells[name] = _uncounted(range(n_cells))
        groups: dict[str, dict[str, IntArray]] = {}
        for what, level in _NODES_OF_LEVEL.items():
            there = level in file.getNonEmptyLevelsExt()
            names = file.getGroupsOnSpecifiedLev(level) if there else ()
            groups[what] = {
                name: file.getGroupArr(level, name).toNumPyArray().astype(np.int64)
                for name in names
            }
        of_nodes = groups["nodes"] | {
            name: file.getGroup(-1, name).computeFetchedNodeIds().toNumPyArray().astype(np.int64)
            for name in groups["faces"]
        }
    except mc.InterpKernelException:
        return None
    return GroupedMesh(points, cells, groups["cells"], of_nodes)

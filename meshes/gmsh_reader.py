"""Meshes that gmsh reads in a process of its own, which hands over the arrays.

A damaged file may spoil the memory of the process that has read it, which ends later: gmsh reads
none of unknown origin in the process that asks.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import meshio
import numpy as np

from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.gmsh_library import running_gmsh
from meshes.med_file import quiet_library

_ROOT = Path(__file__).resolve().parents[1]
_BEGINS = {"gmsh": b"$MeshFormat", "med": b"\x89HDF"}
_GMSH_KINDS = {
    "Point": "vertex", "Line 2": "line", "Line 3": "line3", "Triangle 3": "triangle",
    "Triangle 6": "triangle6", "Quadrilateral 4": "quad", "Quadrilateral 8": "quad8",
    "Quadrilateral 9": "quad9", "Tetrahedron 4": "tetra", "Tetrahedron 10": "tetra10",
    "Hexahedron 8": "hexahedron", "Hexahedron 20": "hexahedron20",
    "Hexahedron 27": "hexahedron27", "Prism 6": "wedge", "Prism 15": "wedge15",
    "Prism 18": "wedge18", "Pyramid 5": "pyramid", "Pyramid 13": "pyramid13",
    "Pyramid 14": "pyramid14",
}  # fmt: skip
_SECONDS = 300.0  # of a loaded machine; that a file can be read in its time has been tried before


def read_elsewhere(path: Path, file_format: str) -> meshio.Mesh:
    """Return what gmsh reads in a file.

    Args:
        path: the file.
        file_format: its format, as `read_with_gmsh` takes it.

    Raises:
        CalledProcessError, TimeoutExpired: it could not be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "mesh.npz"
        path_of_modules = os.pathsep.join(filter(None, (str(_ROOT), os.environ.get("PYTHONPATH"))))
        subprocess.run(
            [sys.executable, "-P", "-m", "meshes.gmsh_reader", path, file_format, target],
            check=True, timeout=_SECONDS, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL, env=os.environ | {"PYTHONPATH": path_of_modules},
        )  # fmt: skip
        with np.load(target) as arrays:
            cells = [(str(kind), arrays[f"cells_{n}"]) for n, kind in enumerate(arrays["kinds"])]
            members = dict(zip(map(str, arrays["groups"]), arrays["members"], strict=True))
            return _mesh(arrays["points"], cells, members)


def read_with_gmsh(path: str | Path, file_format: str) -> meshio.Mesh:
    """Read a file of gmsh or MED by gmsh itself: what meshio does not know of either.

    Such are nodes with their place on a curve or a surface, and MED files without groups.

    Args:
        path: the file.
        file_format: its format, which gmsh knows by the ending.

    Raises:
        Exception: whatever gmsh raises at a damaged file.
        ValueError: it does not begin as its format does.
        SystemLibraryError: a library behind gmsh is missing.
    """
    # Anything else gmsh would run as a script of its own, whatever the ending; so would it options
    # beside the file, of which a copy has none.
    with open(path, "rb") as content:
        if not content.read(len(_BEGINS["gmsh"])).startswith(_BEGINS[file_format]):
            raise ValueError(f"no {file_format} file")
    with tempfile.TemporaryDirectory() as folder:
        return _by_gmsh(Path(shutil.copy(path, Path(folder) / f"mesh{Path(path).suffix.lower()}")))


def _by_gmsh(path: Path) -> meshio.Mesh:
    with quiet_library(), running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(path))
        tags, places, _ = gmsh.model.mesh.getNodes()
        row = np.full(int(tags.max(initial=0)) + 1, -1)
        row[tags.astype(np.int64)] = np.arange(len(tags))
        cells, groups = [], []
        for entity in gmsh.model.getEntities():
            of_entity = _groups_of(gmsh, *entity)
            for kind, _, nodes in zip(*gmsh.model.mesh.getElements(*entity), strict=True):
                name, _, _, n_nodes, *_ = gmsh.model.mesh.getElementProperties(kind)
                of_cells = row[nodes.astype(np.int64)].reshape(-1, n_nodes)
                cells.append((_GMSH_KINDS.get(name, name), of_cells))
                groups.append(of_entity)
        names = sorted(set[str]().union(*groups))
        members = {name: np.array([name in some for some in groups]) for name in names}
        return _mesh(places.reshape(-1, 3), cells, members)


def _groups_of(gmsh: ModuleType, dimension: int, tag: int) -> set[str]:
    """Names of the groups of an entity, or their numbers where they have none."""
    numbers = gmsh.model.getPhysicalGroupsForEntity(dimension, tag)
    named = {int(n): gmsh.model.getPhysicalName(dimension, n) for n in numbers}
    return {name or str(n) for n, name in named.items()}


def _mesh(
    points: FloatArray, cells: list[tuple[str, IntArray]], members: Mapping[str, BoolArray]
) -> meshio.Mesh:
    """Return a mesh whose groups are whole blocks of cells."""
    sets = {
        name: [np.arange(len(nodes) if inside else 0) for (_, nodes), inside in zip(
            cells, of_blocks, strict=True)]
        for name, of_blocks in members.items()
    }  # fmt: skip
    return meshio.Mesh(points, cells, cell_sets=sets)


def main() -> None:
    """Read a file and write its arrays."""
    path, file_format, target = sys.argv[1:]
    mesh = read_with_gmsh(path, file_format)
    arrays = {f"cells_{n}": block.data for n, block in enumerate(mesh.cells)}
    kinds = np.array([block.type for block in mesh.cells], dtype=np.str_)
    groups = np.array(list(mesh.cell_sets), dtype=np.str_)
    members = np.array(
        [[len(ids) > 0 for ids in of_blocks] for of_blocks in mesh.cell_sets.values()], dtype=bool
    ).reshape(len(groups), len(kinds))
    np.savez(target, points=mesh.points, kinds=kinds, groups=groups, members=members, **arrays)


if __name__ == "__main__":
    main()

"""Plane meshes from the files of mesh generators: gmsh, MED (Salome), VTU."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np

from meshes.arrays import IntArray
from meshes.gmsh_reader import read_elsewhere
from meshes.guarded import can_be_read
from meshes.plane_cells import CELLS, CellKind
from meshes.plane_mesh import PlaneMesh

_FORMATS = {".msh": "gmsh", ".med": "med", ".vtu": "vtu"}
_KINDS: dict[str, CellKind] = {
    "triangle": "tri3", "triangle6": "tri6", "quad": "quad4", "quad8": "quad8",
}  # fmt: skip
_LESSER = ("vertex", "line", "line3")  # points and sides of the plane, which are passed over
_FLAT = 1e-6  # of the extent, by which Z may differ


def read_with_meshio(path: str | Path, file_format: str) -> meshio.Mesh:
    """Read a mesh without a word on the terminal.

    Args:
        path: the file.
        file_format: its format, as meshio names it.

    Raises:
        Exception, SystemExit: whatever meshio raises at a damaged file.
    """
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        return meshio.read(path, file_format=file_format)


def _read(path: Path, file_format: str) -> meshio.Mesh | None:
    """Read a file by the first reader that can, None where none can."""
    readers: dict[str, Callable[[Path, str], meshio.Mesh]] = {
        "meshes.plane_files:read_with_meshio": read_with_meshio
    }
    if file_format in ("gmsh", "med"):
        readers["meshes.gmsh_reader:read_with_gmsh"] = read_elsewhere
    for name, read in readers.items():
        # On a damaged file meshio prints and leaves, or fails anywhere in its readers.
        try:
            if can_be_read(name, path, file_format):
                return read(path, file_format)
        except (Exception, SystemExit):
            continue
    return None


def read_plane_mesh(path: Path) -> PlaneMesh:
    """Read the cells of a plane mesh, all of one kind; nodes of none of them are dropped.

    Args:
        path: a file of gmsh (.msh), MED (.med) or VTU (.vtu); X, Y in µm, one Z for all nodes.

    Raises:
        ValueError: no such mesh; the message says what was found and what was expected, not where.
    """
    expected = "a plane mesh of tri3, tri6, quad4 or quad8 (.msh, .med or .vtu)"
    file_format = _FORMATS.get(path.suffix.lower())
    if file_format is None:
        raise ValueError(f"found the ending {path.suffix or 'none'}, expected {expected}")
    if not path.is_file():
        raise ValueError(f"found no such file, expected {expected}")
    mesh = _read(path, file_format)
    if mesh is None:
        raise ValueError(f"found no readable {file_format} file, expected {expected}")
    blocks: dict[CellKind, list[IntArray]] = {}
    for block in mesh.cells:
        if block.type in _LESSER or not len(block.data):
            continue
        if block.type not in _KINDS:
            raise ValueError(f"found cells of the kind {block.type}, expected {expected}")
        kind, nodes = _KINDS[block.type], np.asarray(block.data, dtype=np.int64)
        if nodes.shape[1:] != (CELLS[kind].n_nodes,):
            raise ValueError(f"found {kind} cells of shape {nodes.shape}, expected {expected}")
        blocks.setdefault(kind, []).append(nodes)
    if len(blocks) != 1:
        found = " and ".join(sorted(blocks)) or "none of these cells"
        raise ValueError(f"found {found}, expected {expected}, all cells of one kind")
    ((kind, parts),) = blocks.items()
    used, local = np.unique(np.concatenate(parts), return_inverse=True)
    every = np.asarray(mesh.points, dtype=np.float64)
    if every.ndim != 2 or every.shape[1] not in (2, 3):
        raise ValueError(f"found nodes of shape {every.shape}, expected {expected}")
    if used[0] < 0 or used[-1] >= len(every):
        found = f"cells with the nodes {used[0] + 1} to {used[-1] + 1}"
        raise ValueError(f"found {found}, expected 1 to {len(every)}")
    points = every[used]
    height = np.ptp(points[:, 2:], axis=0).max(initial=0.0)
    if not height <= _FLAT * np.ptp(points[:, :2], axis=0).max():
        raise ValueError(f"found nodes that differ by {height:.3g} µm in Z, expected a plane mesh")
    plane = PlaneMesh(points[:, :2].copy(), local.reshape(-1, CELLS[kind].n_nodes), kind)
    try:
        plane.check()
    except ValueError as error:
        message = str(error).split(";")[0]
        raise ValueError(f"found that {message}, expected cells that hold points") from None
    return plane

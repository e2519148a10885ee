"""All of a MED file, read as a process of its own reads it first."""

from __future__ import annotations

from pathlib import Path

from meshes.files import read_med
from meshes.med_fields import read_med_field
from meshes.med_file import open_med


def read_everything(name: str, mesh: str) -> None:
    """Read a mesh and its fields, whatever of them can be read.

    Args:
        name: path of the file.
        mesh: name of the mesh, "" for the only one.
    """
    path = Path(name)
    for read in (_prism, _fields):
        try:
            read(path, mesh or None)
        except ValueError:
            continue


def _prism(path: Path, mesh: str | None) -> None:
    read_med(path, mesh)


def _fields(path: Path, mesh: str | None) -> None:
    file = open_med(path, mesh)
    file.mesh.getCoords().toNumPyArray()
    file.mesh.getMeshAtLevel(0).getNodalConnectivity().toNumPyArray()
    for field in file.fields:
        try:
            read_med_field(file, field)
        except ValueError:
            continue

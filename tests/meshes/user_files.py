"""Meshes of a user's own: a bar of two grains by gmsh itself, and files with a fault."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np

from meshes.gmsh_library import running_gmsh
from meshes.prism_mesh import PrismMesh

LENGTH, WIDTH, DEPTH = 8.0, 4.0, 3.0
GROUPS = {"S_MINUS": (1, 0.0), "S_PLUS": (1, LENGTH), "TOP": (2, 0.0)}


def gmsh_bar(path: Path, order: int, hexahedra: bool) -> None:
    """A bar of two grains, as a user of gmsh makes it.

    Args:
        path: the file, whose ending tells its format.
        order: 1 for cells with corners alone, 2 for quadratic ones, of hexahedra with 27 nodes.
        hexahedra: in place of tetrahedra.
    """
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 3.0)
        occ = gmsh.model.occ
        boxes = [
            (3, occ.addBox(-WIDTH / 2, y, -DEPTH, WIDTH, LENGTH / 2, DEPTH))
            for y in (0.0, LENGTH / 2)
        ]
        occ.fragment(boxes[:1], boxes[1:])
        occ.synchronize()
        for number, (_, tag) in enumerate(gmsh.model.getEntities(3), start=1):
            gmsh.model.addPhysicalGroup(3, [tag], name=f"GRAIN{number}")
        for name, (axis, value) in GROUPS.items():
            faces = [
                tag
                for _, tag in gmsh.model.getEntities(2)
                if np.allclose(np.array(gmsh.model.getBoundingBox(2, tag))[[axis, axis + 3]],
                               value, atol=1e-6)
            ]  # fmt: skip
            gmsh.model.addPhysicalGroup(2, faces, name=name)
        if hexahedra:
            gmsh.model.mesh.setTransfiniteAutomatic(recombine=True)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))


def write_as_vtu(path: Path, mesh: PrismMesh, change: Callable[[dict[str, Any]], None]) -> None:
    """Write a mesh with its groups as a VTU file, as meshio does.

    Args:
        path: the file.
        mesh: the mesh, tet10 or hex20.
        change: of the points, cells and arrays that are written, in place.
    """
    kind = "tetra10" if mesh.cells.shape[1] == 10 else "hexahedron20"
    rows = np.arange(len(mesh.points))
    data: dict[str, Any] = {
        "points": mesh.points.copy(),
        "cells": {kind: mesh.cells.copy()},
        "grain": mesh.grain + 1,
        "nodes": {name: np.isin(rows, mesh.nodes[name]).astype(float) for name in GROUPS},
    }
    change(data)
    blocks = np.cumsum([len(cells) for cells in data["cells"].values()])[:-1]
    meshio.Mesh(
        data["points"],
        list(data["cells"].items()),
        point_data=data["nodes"],
        cell_data={"grain": np.split(data["grain"], blocks)},
    ).write(path, file_format="vtu")

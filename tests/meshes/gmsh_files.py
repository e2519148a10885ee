"""MED files of another writer: gmsh, with its own MED library."""

from __future__ import annotations

from pathlib import Path

from meshes.gmsh_library import running_gmsh
from tests.meshes.places import DEPTH

BOUNDARY, LENGTH = 5.0, 12.0


def gmsh_prism(path: Path, name: str = "prism", order: int = 2, everything: bool = False) -> None:
    """A prism of two grains as a user of gmsh makes it, named and written as MED.

    Args:
        path: the file.
        name: name of the mesh.
        order: 1 for straight cells with corners alone, 2 for quadratic ones.
        everything: whether faces of no group, edges and points are written, too.
    """
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.add(name)
        geo = gmsh.model.geo
        corners = [geo.addPoint(*at, 3.0) for at in ((-2, 0, 0), (2, 0, 0), (0, 0, -DEPTH))]
        sides = [geo.addLine(corners[k], corners[(k + 1) % 3]) for k in range(3)]
        end = geo.addPlaneSurface([geo.addCurveLoop(sides)])
        first = geo.extrude([(2, end)], 0, BOUNDARY, 0)
        second = geo.extrude([first[0]], 0, LENGTH - BOUNDARY, 0)
        geo.synchronize()
        # An extrusion lists its far end, its volume and its sides, here that of Z = 0 first.
        for dimension, tags, group in (
            (3, [first[1][1]], "GRAIN1"),
            (3, [second[1][1]], "GRAIN2"),
            (2, [end], "S_MINUS"),
            (2, [second[0][1]], "S_PLUS"),
            (2, [first[2][1], second[2][1]], "TOP"),
            (1, [sides[0]], "EDGE"),
            (0, [corners[2]], "APEX"),
        ):
            gmsh.model.addPhysicalGroup(dimension, tags, name=group)
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.SaveAll", everything)
        gmsh.write(str(path))

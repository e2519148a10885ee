"""A specimen from a mesh of the user's own: what it has to be, and its measures.

Cells keep straight edges: of quadratic ones the corners are taken, and a node in the middle of
every edge, as linear ones get it. So a mesh of either order is one of quadratic cells.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from meshes.arrays import FloatArray, IntArray
from meshes.cells import FACES, jacobians
from meshes.grouped_files import GRAIN, GroupedMesh, read_grouped
from meshes.measures import Measures
from meshes.prism import MOST_CELLS, CellKind
from meshes.prism_mesh import FACE_GROUPS, PrismMesh
from meshes.uniform_split import straight_mesh

_CORNERS = {
    "tetra": (4, 4), "tetra10": (4, 10), "hexahedron": (8, 8), "hexahedron20": (8, 20),
    "hexahedron27": (8, 20),
}  # fmt: skip
"""Corners of each kind, and its nodes up to those of its edges."""
_TINY = 1e-6  # of the length, by which two places differ
_FLAT = 1e-4  # Jacobian of a flat cell over the product of its longest edges
_CURVED = 0.25  # of an edge, from its middle to its node
_PROBE = 1e-3  # of a face, from it to a place outside its cell
_END_SIDES = {"S_MINUS": "smallest", "S_PLUS": "largest"}


def read_user_mesh(path: Path) -> PrismMesh:
    """Read a mesh of a specimen.

    Args:
        path: a file of gmsh, MED or VTU, in µm, in the specimen frame, with the groups GRAIN1, …
            of cells, and S_PLUS, S_MINUS and TOP of faces or nodes.

    Raises:
        ValueError: the mesh is none of a specimen; what was found and what was expected, not where.
    """
    return specimen_of(read_grouped(path))


def specimen_of(read: GroupedMesh) -> PrismMesh:
    """Return the mesh of a specimen from what a file holds.

    Args:
        read: the volume cells of the file, and its groups.

    Raises:
        ValueError: as `read_user_mesh`.
    """
    _refuse_absent_groups(read)
    cells, corners = _cells(read)
    grain = _grains(read, len(cells))
    _refuse_doubled_cells(corners, grain)
    points = _points(read, cells)
    _refuse_doubled_nodes(points, corners)
    _refuse_moved_middles(points, cells, corners.shape[1])
    _refuse_other_frame(read, points, corners)
    mesh = straight_mesh(points, corners, grain)
    _refuse_bad_cells(mesh)
    _refuse_gaps(mesh)
    _refuse_other_face(mesh)
    return mesh


def measures_of(mesh: PrismMesh) -> Measures:
    """Return the measures of a specimen.

    Args:
        mesh: of straight cells, in the specimen frame.
    """
    corners = mesh.cells[:, : 4 if mesh.cells.shape[1] == 10 else 8]
    x, y, z = mesh.points.T
    end = mesh.faces["S_MINUS"]
    kind: CellKind = "tet10" if corners.shape[1] == 4 else "hex20"
    if kind == "tet10":
        size = float(_edge_lengths(mesh).mean())
    else:
        size = float(np.sqrt(_areas(mesh.points, end).mean()))
    length = float(y.max())
    return Measures(
        length, float(np.ptp(x[mesh.nodes["TOP"]])), -float(z.min()), _volume(mesh) / length, size,
        kind, mesh.n_grains, len(end),
    )  # fmt: skip


def _refuse_absent_groups(read: GroupedMesh) -> None:
    missing = [name for name in FACE_GROUPS if name not in read.of_nodes]
    if f"{GRAIN}1" not in read.of_cells:
        missing.insert(0, f"{GRAIN}1")
    if missing:
        cells, others = (", ".join(sorted(groups)) or "none" for groups in (
            read.of_cells, read.of_nodes))  # fmt: skip
        raise ValueError(
            f"found the groups {cells} of cells and {others} of faces or nodes, expected "
            f"{', '.join(missing)} as well"
        )


def _cells(read: GroupedMesh) -> tuple[IntArray, IntArray]:
    """Nodes of the cells up to those of the edges, and their corners."""
    kinds = [kind for kind, cells in read.cells.items() if len(cells)]
    if len(kinds) != 1 or kinds[0] not in _CORNERS:
        found = " and ".join(sorted(kinds)) or "no cells"
        raise ValueError(f"found {found}, expected tetrahedra alone or hexahedra alone")
    n_corners, n_nodes = _CORNERS[kinds[0]]
    cells = read.cells[kinds[0]][:, :n_nodes]
    if len(cells) > MOST_CELLS:
        raise ValueError(f"found {len(cells)} cells, expected {MOST_CELLS} at most")
    if cells.min() < 0 or cells.max() >= len(read.points):
        found = f"cells with the nodes {cells.min() + 1} to {cells.max() + 1}"
        raise ValueError(f"found {found}, expected 1 to {len(read.points)}")
    return cells, cells[:, :n_corners]


def _points(read: GroupedMesh, cells: IntArray) -> FloatArray:
    points = read.points
    if points.ndim != 2 or points.shape[1] != 3:
        raise ValueError(f"found nodes of shape {points.shape}, expected X, Y and Z of each")
    if not np.isfinite(points[np.unique(cells)]).all():
        raise ValueError("found nodes at no finite place, expected numbers")
    return points


def _grains(read: GroupedMesh, n_cells: int) -> IntArray:
    """Index of the grain of each cell, shape (n_cells,)."""
    names = sorted(
        name
        for name in read.of_cells
        if name.startswith(GRAIN) and name.removeprefix(GRAIN).isdecimal()
    )
    expected = [f"{GRAIN}{number}" for number in range(1, len(names) + 1)]
    if set(names) != set(expected):
        raise ValueError(f"found the grains {', '.join(names)}, expected {', '.join(expected)}")
    counted, grain = np.zeros(n_cells, dtype=np.int64), np.zeros(n_cells, dtype=np.int64)
    for number, name in enumerate(expected):
        members = read.of_cells[name]
        grain[members] = number
        counted[np.unique(members)] += 1
    for wrong, where in ((counted == 0, "no grain"), (counted > 1, "two grains")):
        if wrong.any():
            raise ValueError(
                f"found {int(wrong.sum())} of {n_cells} cells in {where}, expected each in one of "
                f"{', '.join(expected)}"
            )
    return grain


def _refuse_doubled_cells(corners: IntArray, grain: IntArray) -> None:
    _, first, cell, count = np.unique(
        np.sort(corners, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    doubled = int((count > 1).sum())
    if doubled:
        twice = (grain != grain[first[cell.ravel()]]).any()
        what = "cells in two grains" if twice else "cells twice"
        raise ValueError(f"found {doubled} {what}, expected each once, in one grain")


def _refuse_doubled_nodes(points: FloatArray, corners: IntArray) -> None:
    used = np.unique(corners)
    extent = np.ptp(points[used], axis=0).max()
    pairs = cKDTree(points[used]).query_pairs(_TINY * extent, output_type="ndarray")
    if len(pairs):
        at = points[used[pairs[0, 0]]]
        raise ValueError(
            f"found {len(np.unique(pairs[:, 1]))} nodes at the place of another one, the first at "
            f"{_place(at)}, expected one node where cells meet: parts that touch are to be made "
            "one before they are meshed"
        )


def _refuse_moved_middles(points: FloatArray, cells: IntArray, n_corners: int) -> None:
    """Refuse nodes of edges that lie far from the middle of every edge of their cell."""
    if cells.shape[1] == n_corners:
        return
    n_nodes = {4: 10, 8: 20}[n_corners]
    faces = FACES[n_nodes][:, : 3 if n_corners == 4 else 4]
    pairs = {tuple(sorted((f[k - 1], f[k]))) for f in faces.tolist() for k in range(len(f))}
    ends = points[cells[:, np.array(sorted(pairs))]]
    middles, lengths = ends.mean(axis=2), np.linalg.norm(np.diff(ends, axis=2)[:, :, 0], axis=2)
    off = np.linalg.norm(middles[:, :, None] - points[cells[:, n_corners:]][:, None], axis=3)
    far = ((off / lengths[:, :, None]).min(axis=1) > _CURVED).any(axis=1)
    if far.any():
        at = points[cells[np.argmax(far), :n_corners]].mean(axis=0)
        raise ValueError(
            f"found {int(far.sum())} cells with a node of an edge far from its middle, the first "
            f"at {_place(at)}, expected quadratic cells with edges all but straight"
        )


def _refuse_bad_cells(mesh: PrismMesh) -> None:
    corners = mesh.cells[:, : 4 if mesh.cells.shape[1] == 10 else 8]
    longest = np.linalg.norm(
        mesh.points[corners] - mesh.points[corners[:, :1]], axis=2
    ).max(axis=1)  # fmt: skip
    shares = jacobians(mesh.points, mesh.cells).min(axis=1) / longest**3
    for bad, what in ((~(shares > 0), "a Jacobian ≤ 0"), (shares < _FLAT, "all but no volume")):
        if bad.any():
            at = mesh.points[corners[np.argmax(bad)]].mean(axis=0)
            raise ValueError(
                f"found {int(bad.sum())} of {len(corners)} cells with {what}, the first at "
                f"{_place(at)}, expected cells that are not turned inside out or flat"
            )


def _refuse_gaps(mesh: PrismMesh) -> None:
    """Refuse cells that do not meet in whole faces."""
    table = FACES[mesh.cells.shape[1]]
    n_corners = table.shape[1] // 2
    faces = mesh.cells[:, table[:, :n_corners]].reshape(-1, n_corners)
    cell = np.repeat(np.arange(len(mesh.cells)), len(table))
    _, first, which, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    if count.max() > 2:
        at = mesh.points[faces[first[np.argmax(count)]]].mean(axis=0)
        raise ValueError(
            f"found a face of {count.max()} cells at {_place(at)}, expected cells that do not "
            "overlap"
        )
    inside = _faces_inside(mesh, faces[first[count == 1]], cell[first[count == 1]])
    if len(inside):
        raise ValueError(
            f"found {len(inside)} faces inside the specimen whose cells do not share all nodes "
            f"with those beyond, the first at {_place(inside[0])}, expected cells that meet in "
            "whole faces, without hanging nodes"
        )
    order = np.argsort(which.ravel(), kind="stable")
    pairs = order[1:][np.diff(which.ravel()[order]) == 0], order[:-1][np.diff(which.ravel()[order])
                                                                     == 0]  # fmt: skip
    links = coo_array((np.ones(len(pairs[0])), (cell[pairs[0]], cell[pairs[1]])),
                      shape=(len(mesh.cells),) * 2)  # fmt: skip
    parts, _ = connected_components(links, directed=False)
    if parts > 1:
        raise ValueError(f"found {parts} parts that share no face, expected one specimen")


def _faces_inside(mesh: PrismMesh, faces: IntArray, cell: IntArray) -> FloatArray:
    """Middles of outer faces beyond which there is another cell, shape (n, 3)."""
    corners = mesh.points[faces]
    middles = corners.mean(axis=1)
    normals = _normals(corners)
    areas = np.linalg.norm(normals, axis=1)
    probes = middles + _PROBE * normals / np.sqrt(areas)[:, None]
    table = FACES[mesh.cells.shape[1]]
    of_cells = mesh.points[mesh.cells[:, table[:, : table.shape[1] // 2]]]
    walls, outward = of_cells.mean(axis=2), _normals(of_cells)
    centres = walls.mean(axis=1)
    radii = np.linalg.norm(of_cells - centres[:, None, None], axis=3).max(axis=(1, 2))
    near = cKDTree(probes).query_ball_point(centres, radii)
    there = np.repeat(np.arange(len(near)), [len(some) for some in near])
    probe = np.concatenate([np.asarray(some, dtype=np.int64) for some in near])
    other = there != cell[probe]
    there, probe = there[other], probe[other]
    heights = ((probes[probe, None] - walls[there]) * outward[there]).sum(axis=2)
    within = (heights < 0).all(axis=1)
    found: FloatArray = middles[np.unique(probe[within])]
    return found


def _refuse_other_frame(read: GroupedMesh, points: FloatArray, corners: IntArray) -> None:
    """Refuse a mesh that lies elsewhere than the specimen frame says."""
    used = np.unique(corners)
    y, z = points[used, 1], points[used, 2]
    tolerance = _TINY * np.ptp(points[used], axis=0).max()
    groups = {}
    for name in FACE_GROUPS:
        groups[name] = points[np.intersect1d(read.of_nodes[name], used)]
        if len(groups[name]) < 3:
            raise ValueError(
                f"found the group {name} with {len(groups[name])} corners of cells, expected a face"
            )
    ends = {"S_MINUS": (y.min(), 0.0), "S_PLUS": (y.max(), y.max())}
    for name, (place, expected) in ends.items():
        there = groups[name][:, 1]
        if np.ptp(there) > tolerance:
            raise ValueError(
                f"found {name} with Y from {there.min():.6g} to {there.max():.6g} µm, expected a "
                f"plane face at the {_END_SIDES[name]} Y"
            )
        if abs(there.mean() - place) > tolerance:
            raise ValueError(
                f"found {name} at Y = {there.mean():.6g} µm of cells from {y.min():.6g} to "
                f"{y.max():.6g} µm, expected it at the {_END_SIDES[name]} Y"
            )
        if abs(place - expected) > tolerance:
            raise ValueError(f"found {name} at Y = {place:.6g} µm, expected Y = 0")
    height = groups["TOP"][:, 2]
    if np.ptp(height) > tolerance:
        raise ValueError(
            f"found TOP with Z from {height.min():.6g} to {height.max():.6g} µm, expected a plane "
            "face at Z = 0"
        )
    if abs(height.mean()) > tolerance:
        raise ValueError(f"found TOP at Z = {height.mean():.6g} µm, expected Z = 0")
    if z.max() > tolerance:
        raise ValueError(
            f"found cells up to Z = {z.max():.6g} µm, expected none above TOP at Z = 0: Z points "
            "out of the measured face"
        )
    x = groups["TOP"][:, 0]
    if abs(x.min() + x.max()) > 2 * tolerance:
        half = np.ptp(x) / 2
        raise ValueError(
            f"found TOP with X from {x.min():.6g} to {x.max():.6g} µm, expected {-half:.6g} to "
            f"{half:.6g}: X = 0 is the middle of the measured face"
        )
    places = {"S_MINUS": (1, 0.0), "S_PLUS": (1, y.max()), "TOP": (2, 0.0)}
    for name, (axis, value) in places.items():
        lacking = np.setdiff1d(used[np.abs(points[used, axis] - value) <= tolerance],
                               read.of_nodes[name])  # fmt: skip
        if len(lacking):
            raise ValueError(
                f"found {len(lacking)} nodes in the plane of {name} that are not in the group, the "
                f"first at {_place(points[lacking[0]])}, expected the whole face"
            )


def _refuse_other_face(mesh: PrismMesh) -> None:
    """Refuse a measured face that is no rectangle from end to end."""
    width = float(np.ptp(mesh.points[mesh.nodes["TOP"], 0]))
    whole, found = width * float(mesh.points[:, 1].max()), 0.0
    if len(mesh.faces["TOP"]):
        found = float(_areas(mesh.points, mesh.faces["TOP"]).sum())
    if abs(found - whole) > _FLAT * whole:
        raise ValueError(
            f"found TOP with an area of {found:.6g} µm², expected {whole:.6g}: a rectangle from "
            "end to end"
        )


def _normals(corners: FloatArray) -> FloatArray:
    """Outward normals of faces by the places of their corners (…, 3 or 4, 3), as long as areas."""
    last = corners.shape[-2] - 1
    first = corners[..., 2 if last == 3 else 1, :] - corners[..., 0, :]
    return np.asarray(np.cross(first, corners[..., last, :] - corners[..., last - 2, :]) / 2)


def _areas(points: FloatArray, faces: IntArray) -> FloatArray:
    return np.asarray(np.linalg.norm(_normals(points[faces[:, : faces.shape[1] // 2]]), axis=1))


def _edge_lengths(mesh: PrismMesh) -> FloatArray:
    """Length of each edge of each tetrahedron, shape (n_cells, 6)."""
    corners = mesh.points[mesh.cells[:, :4]]
    first, second = np.triu_indices(4, 1)
    return np.asarray(np.linalg.norm(corners[:, first] - corners[:, second], axis=2))


def _volume(mesh: PrismMesh) -> float:
    """Volume [µm³], by the flux of (X, Y, Z)/3 through the faces of each cell."""
    table = FACES[mesh.cells.shape[1]]
    faces = mesh.points[mesh.cells[:, table[:, : table.shape[1] // 2]]]
    if faces.shape[2] == 4:  # in triangles about the middle, as the faces of both cells agree
        middle = faces.mean(axis=2, keepdims=True)
        ahead = np.roll(faces, -1, axis=2)
        return float(_flux(np.broadcast_to(middle, faces.shape), faces, ahead).sum())
    return float(_flux(faces[:, :, 0], faces[:, :, 1], faces[:, :, 2]).sum())


def _flux(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    return np.asarray((a * np.cross(b, c)).sum(axis=-1) / 6)


def _place(at: FloatArray) -> str:
    x, y, z = (f"{value:.4g}" for value in at)
    return f"({x}, {y}, {z}) µm"

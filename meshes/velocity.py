"""Node velocities of the geometric parameters, and the mesh moved along them.

A velocity is the derivative of the node coordinates with respect to one parameter. It is computed
at the corners and averaged at the mid-edge nodes, so that cells keep straight sides. Every field
keeps each named face in its plane and each node on its side face.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from meshes.arrays import FloatArray
from meshes.cells import EDGES, inverted_cells
from meshes.prism import PrismGeometry
from meshes.prism_mesh import PrismMesh


class InvertedCellsError(ValueError):
    """A change of the geometry that turns cells inside out."""


def boundary_shift(mesh: PrismMesh, geometry: PrismGeometry, number: int = 1) -> FloatArray:
    """Velocity that moves a grain boundary along +Y, fading linearly to zero.

    It is zero at the neighbouring boundaries, or at the ends of the prism.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its grain boundaries as they stand.
        number: of the boundary, from 1.

    Returns:
        velocity [µm per µm], shape (n_nodes, 3), one on the boundary.

    Raises:
        ValueError: a grain boundary meets an end face, or there is none of this number.
    """
    return _boundary_motion(mesh, geometry, number, np.ones(len(mesh.points)))


def boundary_tilt(
    mesh: PrismMesh, geometry: PrismGeometry, axis: Literal["x", "z"], number: int = 1
) -> FloatArray:
    """Velocity that tilts a grain boundary about a point of the section's centre line.

    The boundary moves along Y by X (axis "x") or by Z above that line (axis "z") per unit of slope:
    it changes −n_x/n_y or −n_z/n_y of the normal n by one.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its grain boundaries as they stand.
        axis: the direction along which the boundary gains a slope.
        number: of the boundary, from 1.

    Returns:
        velocity [µm per unit slope], shape (n_nodes, 3).

    Raises:
        ValueError: a grain boundary meets an end face, or there is none of this number.
    """
    x, _, z = mesh.points.T
    profile = x if axis == "x" else z + geometry.section.centroid_depth
    return _boundary_motion(mesh, geometry, number, profile)


def boundary_bow(mesh: PrismMesh, geometry: PrismGeometry, number: int = 1) -> FloatArray:
    """Velocity that bows a grain boundary along +Y, by 1 − (2X/width)² per unit of bow.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its plane grain boundaries.
        number: of the boundary, from 1.

    Returns:
        velocity [µm per µm], shape (n_nodes, 3), one at X = 0 on the boundary.

    Raises:
        ValueError: a grain boundary meets an end face, or there is none of this number.
    """
    profile = 1 - (2 * mesh.points[:, 0] / geometry.width) ** 2
    return _boundary_motion(mesh, geometry, number, profile)


def depth_scale(mesh: PrismMesh, geometry: PrismGeometry) -> FloatArray:
    """Velocity of a relative change of depth, Z → Z (1 + δ).

    Grain boundaries are stretched along with the rest of the section.

    Args:
        mesh: the prism.
        geometry: not needed here; every field of this module is called the same way.

    Returns:
        velocity (0, 0, Z) [µm per unit], shape (n_nodes, 3).
    """
    velocity = np.zeros_like(mesh.points)
    velocity[:, 2] = mesh.points[:, 2]
    return velocity


def apex_shift(mesh: PrismMesh, geometry: PrismGeometry) -> FloatArray:
    """Velocity that moves the apex line, or far side, along +X while the measured face stays.

    Args:
        mesh: the prism.
        geometry: gives the depth.

    Returns:
        velocity (−Z/depth, 0, 0) [µm per µm], shape (n_nodes, 3).
    """
    velocity = np.zeros_like(mesh.points)
    velocity[:, 0] = -mesh.points[:, 2] / geometry.depth
    return velocity


def moved(mesh: PrismMesh, displacement: FloatArray) -> PrismMesh:
    """Return the mesh with its nodes moved; cells, grains and groups stay.

    Args:
        mesh: the prism.
        displacement: [µm], shape (n_nodes, 3).

    Returns:
        the moved mesh, every Jacobian positive.

    Raises:
        InvertedCellsError: a cell would be turned inside out.
    """
    points = mesh.points + displacement
    inverted = inverted_cells(points, mesh.cells)
    if len(inverted):
        raise InvertedCellsError(
            f"the geometry change inverts {len(inverted)} of {len(mesh.cells)} cells: "
            "a smaller change or a new mesh is needed"
        )
    return replace(mesh, points=points)


def _boundary_motion(
    mesh: PrismMesh, geometry: PrismGeometry, number: int, profile: FloatArray
) -> FloatArray:
    """Motion along Y by `profile` (n_nodes,) on a boundary, linear to zero at the next ones."""
    if not 1 <= number <= len(geometry.boundaries):
        raise ValueError(
            f"there is no grain boundary {number}: the prism has {len(geometry.boundaries)} of them"
        )
    y, heights = mesh.points[:, 1], geometry.heights(mesh.points)
    ends = [np.zeros(1), *heights, np.full(1, geometry.length)]
    if not geometry.along_y:
        ends = [ends[0], *heights[::-1], ends[-1]]
        number = len(heights) + 1 - number
    lower, height, upper = ends[number - 1 : number + 2]
    fade = np.where(y <= height, (y - lower) / (height - lower), (upper - y) / (upper - height))
    velocity = np.zeros_like(mesh.points)
    velocity[:, 1] = np.maximum(fade, 0.0) * profile
    edges = EDGES[mesh.cells.shape[1]]
    middle = mesh.cells[:, -len(edges) :]
    velocity[middle] = velocity[mesh.cells[:, edges]].mean(axis=2)
    return velocity

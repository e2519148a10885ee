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


def boundary_shift(mesh: PrismMesh, geometry: PrismGeometry) -> FloatArray:
    """Velocity that moves the grain boundary along +Y, fading linearly to zero at both ends.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its grain boundary as they stand.

    Returns:
        velocity [µm per µm], shape (n_nodes, 3), one on the boundary.

    Raises:
        ValueError: the grain boundary meets an end face, or there is none.
    """
    return _boundary_motion(mesh, geometry, np.ones(len(mesh.points)))


def boundary_tilt(mesh: PrismMesh, geometry: PrismGeometry, axis: Literal["x", "z"]) -> FloatArray:
    """Velocity that tilts the grain boundary about a point of the section's centre line.

    The boundary moves along Y by X (axis "x") or by Z above that line (axis "z") per unit of slope:
    it changes −n_x/n_y or −n_z/n_y of the normal n by one.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its grain boundary as they stand.
        axis: the direction along which the boundary gains a slope.

    Returns:
        velocity [µm per unit slope], shape (n_nodes, 3).

    Raises:
        ValueError: the grain boundary meets an end face, or there is none.
    """
    x, _, z = mesh.points.T
    return _boundary_motion(
        mesh, geometry, x if axis == "x" else z + geometry.section.centroid_depth
    )


def boundary_bow(mesh: PrismMesh, geometry: PrismGeometry) -> FloatArray:
    """Velocity that bows the grain boundary along +Y, by 1 − (2X/width)² per unit of bow.

    Args:
        mesh: the prism, generated from this geometry or moved to it.
        geometry: the prism and its plane grain boundary.

    Returns:
        velocity [µm per µm], shape (n_nodes, 3), one at X = 0 on the boundary.

    Raises:
        ValueError: the grain boundary meets an end face, or there is none.
    """
    return _boundary_motion(mesh, geometry, 1 - (2 * mesh.points[:, 0] / geometry.width) ** 2)


def depth_scale(mesh: PrismMesh, geometry: PrismGeometry) -> FloatArray:
    """Velocity of a relative change of depth, Z → Z (1 + δ).

    A grain boundary is stretched along with the rest of the section.

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


def _boundary_motion(mesh: PrismMesh, geometry: PrismGeometry, profile: FloatArray) -> FloatArray:
    """Motion along Y by `profile` (n_nodes,) on the boundary, linear in Y to zero at the ends."""
    y = mesh.points[:, 1]
    height = geometry.boundary_height(mesh.points)
    fade = np.where(y <= height, y / height, (geometry.length - y) / (geometry.length - height))
    velocity = np.zeros_like(mesh.points)
    velocity[:, 1] = fade * profile
    edges = EDGES[mesh.cells.shape[1]]
    middle = mesh.cells[:, -len(edges) :]
    velocity[middle] = velocity[mesh.cells[:, edges]].mean(axis=2)
    return velocity

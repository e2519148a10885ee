"""Small boxes of tet10 or hex20 cells, made by hand, and simulations that pull them along Y."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations

import numpy as np

from meshes import hex20
from meshes.arrays import FloatArray, IntArray
from meshes.cells import EDGES
from meshes.prism_mesh import PrismMesh
from solver_adapters.crystal import bunge_matrix
from solver_adapters.interface import Simulation
from solver_adapters.material import Material

ORIENTATIONS = np.stack([bunge_matrix(281, 8, 47), bunge_matrix(211, 45, 150)])


def box(
    shape: tuple[int, int, int] = (1, 2, 1),
    size: tuple[float, float, float] = (2.0, 4.0, 2.0),
    jitter: float = 0.0,
) -> PrismMesh:
    """Mesh a box from the origin to `size` [µm], six tetrahedra a brick; grain 1 is above.

    Inner corners are moved by up to `jitter` of a brick, edges stay straight.
    """
    points, number = _corners(shape, size, jitter)
    cells = []
    for base in np.ndindex(*shape):
        for axes in permutations(range(3)):
            path = [np.array(base)]
            for axis in axes:
                path.append(path[-1] + np.eye(3, dtype=int)[axis])
            tet = [int(number[tuple(corner)]) for corner in path]
            edges = points[tet[1:]] - points[tet[0]]
            cells.append(tet if np.linalg.det(edges) > 0 else [tet[0], tet[2], tet[1], tet[3]])
    return _quadratic(points, np.array(cells), EDGES[10], size[1])


def _corners(
    shape: tuple[int, int, int], size: tuple[float, float, float], jitter: float
) -> tuple[FloatArray, IntArray]:
    """Corners of the bricks (n, 3) [µm], and their numbers by place in the grid."""
    n = np.array(shape)
    grid = np.stack(np.meshgrid(*[np.arange(k + 1) for k in n], indexing="ij"), axis=-1)
    corners = grid.reshape(-1, 3)
    inside = ((corners > 0) & (corners < n)).all(axis=1, keepdims=True)
    moves = np.random.default_rng(3).uniform(-jitter, jitter, corners.shape)
    points = (corners + moves * inside) * np.array(size) / n
    return points, np.arange(len(corners)).reshape(n + 1)


def _quadratic(corners: FloatArray, cells: IntArray, edges: IntArray, length: float) -> PrismMesh:
    """Cells of corners with a node in the middle of each edge, their grains and end faces."""
    pairs = np.sort(cells[:, edges].reshape(-1, 2), axis=1)
    unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
    middle = len(corners) + inverse.reshape(len(cells), len(edges))
    points = np.concatenate([corners, corners[unique].mean(axis=1)])
    centre = corners[cells].mean(axis=1)[:, 1]
    return PrismMesh(
        points=points,
        cells=np.concatenate([cells, middle], axis=1),
        grain=(centre > length / 2).astype(np.int64),
        faces={},
        nodes={
            "S_MINUS": np.flatnonzero(points[:, 1] < 1e-9),
            "S_PLUS": np.flatnonzero(points[:, 1] > length - 1e-9),
        },
    )


def one_grain(mesh: PrismMesh) -> PrismMesh:
    """Return the mesh as a single crystal."""
    return replace(mesh, grain=np.zeros_like(mesh.grain))


def skin(mesh: PrismMesh) -> IntArray:
    """Nodes on the surface of a box."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    return np.flatnonzero(((mesh.points < low + 1e-9) | (mesh.points > high - 1e-9)).any(axis=1))


def moved(
    mesh: PrismMesh,
    material: Material,
    nodes: IntArray,
    displacement: Callable[[float, FloatArray], FloatArray],
    times: FloatArray,
    tolerance: float = 1e-9,
    steps: int = 1,
) -> Simulation:
    """Return the displacement (time, points) → (n, 3) prescribed on `nodes`; all else is free."""
    return Simulation(
        mesh=mesh,
        material=material,
        orientations=ORIENTATIONS[: mesh.n_grains],
        times=times,
        motion_nodes=nodes,
        motion_mask=np.ones((len(nodes), 3), dtype=np.bool_),
        motion=np.stack([displacement(float(t), mesh.points[nodes]) for t in times]),
        output=np.arange(len(times)),
        output_nodes=np.arange(len(mesh.points)),
        steps_per_interval=steps,
        tolerance=tolerance,
    )


def pulled(
    mesh: PrismMesh,
    material: Material,
    strains: tuple[float, ...],
    interval: float = 1.0,
    tolerance: float = 1e-9,
    steps: int = 1,
) -> Simulation:
    """Clamped ends; the upper one moves along Y by `strains` of the length, one each interval."""
    ends = np.concatenate([mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]])
    length = float(mesh.points[:, 1].max())
    history = np.array([0.0, *strains])
    times = interval * np.arange(len(history), dtype=np.float64)

    def displacement(time: float, points: FloatArray) -> FloatArray:
        strain = np.interp(time, times, history)
        return np.asarray(strain * points * [0.0, 1.0, 0.0] * (points[:, [1]] > length / 2))

    return moved(mesh, material, ends, displacement, times, tolerance, steps)


def hex_box(
    shape: tuple[int, int, int] = (2, 2, 1),
    size: tuple[float, float, float] = (2.0, 4.0, 2.0),
    jitter: float = 0.0,
) -> PrismMesh:
    """Return the box of `box` in twenty-node hexahedra, one to a brick.

    A column one brick wide has motions without strain at the Gauss points.
    """
    points, number = _corners(shape, size, jitter)
    brick = hex20.CHECKED[:8].astype(np.int64) // 2 + 1
    cells = [[int(number[tuple(corner)]) for corner in base + brick] for base in np.ndindex(*shape)]
    return _quadratic(points, np.array(cells), EDGES[20], size[1])


BOXES = {"tet10": box, "hex20": hex_box}


def uniaxial(
    material: Material, rotation: FloatArray, times: FloatArray, strains: FloatArray
) -> Simulation:
    """One crystal of 1 µm² under uniaxial stress along Y: its ends stay flat, the rest is free.

    Args:
        material: the law.
        rotation: crystal → specimen, shape (3, 3).
        times: instants [s], shape (n_times,).
        strains: strain along Y at the instants, shape (n_times,).
    """
    mesh = box(size=(1.0, 2.0, 1.0))
    mesh = replace(mesh, grain=np.zeros_like(mesh.grain))
    low, high = mesh.nodes["S_MINUS"], mesh.nodes["S_PLUS"]
    nodes = np.concatenate([low, high])
    mask = np.zeros((len(nodes), 3), dtype=np.bool_)
    mask[:, 1] = True
    # A corner pins X and Z; a second one along X stops the turn about Y.
    x, z = mesh.points[low][:, [0, 2]].T
    mask[np.flatnonzero((x < 1e-9) & (z < 1e-9)), ::2] = True
    mask[np.flatnonzero((x > 1 - 1e-9) & (z < 1e-9)), 2] = True
    motion = np.zeros((len(times), len(nodes), 3))
    motion[:, len(low) :, 1] = 2.0 * strains[:, None]
    return Simulation(
        mesh=mesh,
        material=material,
        orientations=rotation[None],
        times=times,
        motion_nodes=nodes,
        motion_mask=mask,
        motion=motion,
        output=np.arange(len(times)),
        output_nodes=np.arange(0),
        tolerance=1e-9,
        integration="backward_euler",
    )

"""The discrete boundary-value problem of a simulation: what does not change while it runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.assembly import Pattern, stiffness_pattern
from solver_adapters.bundled.element import shape_gradient_velocity, shape_gradients
from solver_adapters.bundled.law import local_parameters, local_tangent
from solver_adapters.bundled.points import Points
from solver_adapters.interface import Direction, Simulation

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Problem:
    """Geometry, law and prescribed motion of a simulation.

    Attributes:
        cells: tet10 connectivity, (n_cells, 10).
        n_nodes: number of nodes.
        gradients: shape gradients turned into the crystal [1/µm], (n_cells, 4, 10, 3).
        weights: Gauss weights [µm³], (n_cells, 4).
        points: the crystal law at the Gauss points.
        pattern: sparsity of the stiffness on the free degrees of freedom.
        prescribed: prescribed degrees of freedom 3·node + component.
        motion: their displacement at each instant [µm], (n_times, n_prescribed).
        pulled: degrees of freedom whose sum of internal forces is the answered force.
    """

    cells: IntArray
    n_nodes: int
    gradients: FloatArray
    weights: FloatArray
    points: Points
    pattern: Pattern
    prescribed: IntArray
    motion: FloatArray
    pulled: IntArray


@dataclass(frozen=True, eq=False)
class Tangents:
    """All directions of a simulation in the discrete terms of its problem, k directions.

    Attributes:
        local: derivative of the local constants, (n_grains, k, 11).
        rotation: derivative of the crystal rotations, (n_grains, k, 3, 3).
        motion: derivative of the prescribed motion, (n_times, n_prescribed, k).
        geometric: the directions that move nodes or turn crystals.
        gradients: derivative of the turned shape gradients for those, (g, n_cells, 4, 10, 3).
        weights: derivative of the weights for those, (g, n_cells, 4).
    """

    local: FloatArray
    rotation: FloatArray
    motion: FloatArray
    geometric: IntArray
    gradients: FloatArray
    weights: FloatArray

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(self.local.shape[1])


def build_problem(simulation: Simulation) -> Problem:
    """Discretise a simulation.

    Raises:
        ValueError: a cell of the mesh is inverted.
    """
    mesh = simulation.mesh
    gradients, weights = shape_gradients(mesh.points, mesh.cells)
    turned = np.einsum("eqai,eij->eqaj", gradients, simulation.orientations[mesh.grain])
    mask = np.zeros(3 * len(mesh.points), dtype=np.bool_)
    dofs = 3 * simulation.motion_nodes[:, None] + np.arange(3)
    mask[dofs[simulation.motion_mask]] = True
    return Problem(
        cells=mesh.cells,
        n_nodes=len(mesh.points),
        gradients=np.ascontiguousarray(turned),
        weights=weights,
        points=Points(
            simulation.material.strain_measure,
            np.repeat(mesh.grain, 4),
            local_parameters(simulation.material, mesh.n_grains),
            simulation.orientations,
        ),
        pattern=stiffness_pattern(mesh.cells, mask),
        prescribed=dofs[simulation.motion_mask],
        motion=np.ascontiguousarray(simulation.motion[:, simulation.motion_mask]),
        pulled=3 * mesh.nodes["S_PLUS"] + 1,
    )


def _spin(vector: FloatArray) -> FloatArray:
    x, y, z = vector
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def build_tangents(simulation: Simulation, problem: Problem) -> Tangents:
    """Put the directions of a simulation into the terms of its problem."""
    mesh, k = simulation.mesh, len(simulation.directions)
    n_grains = mesh.n_grains
    local = np.zeros((n_grains, k, problem.points.local.shape[1]))
    rotation = np.zeros((n_grains, k, 3, 3))
    motion = np.zeros((*problem.motion.shape, k))
    geometric, gradients, weights = [], [], []
    plain, _ = shape_gradients(mesh.points, mesh.cells)
    for index, direction in enumerate(simulation.directions):
        for name, rate in direction.material.items():
            local[:, index] += rate * local_tangent(simulation.material, n_grains, name)
        if direction.motion is not None:
            motion[:, :, index] = direction.motion[:, simulation.motion_mask]
        if direction.rotation is not None:
            for grain, vector in enumerate(direction.rotation):
                rotation[grain, index] = _spin(vector) @ simulation.orientations[grain]
        if direction.rotation is not None or direction.points is not None:
            geometric.append(index)
            change, weight_change = _geometric_change(
                simulation, direction, plain, problem, rotation[:, index]
            )
            gradients.append(change)
            weights.append(weight_change)
    shape = problem.gradients.shape
    return Tangents(
        local=local,
        rotation=rotation,
        motion=motion,
        geometric=np.array(geometric, dtype=np.int64),
        gradients=np.array(gradients).reshape(len(geometric), *shape),
        weights=np.array(weights).reshape(len(geometric), *problem.weights.shape),
    )


def _geometric_change(
    simulation: Simulation,
    direction: Direction,
    plain: FloatArray,
    problem: Problem,
    rotation: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    grain = simulation.mesh.grain
    change = np.einsum("eqai,eij->eqaj", plain, rotation[grain])
    weight_change = np.zeros_like(problem.weights)
    if direction.points is not None:
        moved, weight_change = shape_gradient_velocity(
            plain, problem.weights, simulation.mesh.cells, direction.points
        )
        change += np.einsum("eqai,eij->eqaj", moved, simulation.orientations[grain])
    return change, weight_change

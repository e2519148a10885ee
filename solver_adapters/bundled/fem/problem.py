"""The discrete boundary-value problem of a simulation: what does not change while it runs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.fem.assembly import (
    Pattern,
    direction_gradients,
    displacement_gradients,
    element_forces,
    stiffness_pattern,
)
from solver_adapters.bundled.fem.dilatation import (
    Dilatation,
    DilatationChanges,
    dilatation_changes,
    mean_dilatation,
)
from solver_adapters.bundled.fem.element import (
    Element,
    element_of,
    shape_gradient_velocity,
    shape_gradients,
)
from solver_adapters.bundled.fem.fields import (
    Frames,
    acts_at_rest,
    at_rest,
    at_rest_change,
    crystal_frames,
    frame_change,
)
from solver_adapters.bundled.law.gauss_points import Points, PointTangents, points_of_grains
from solver_adapters.bundled.law.law import local_tangent, longer_step_tangent
from solver_adapters.interface import Direction, Simulation


@dataclass(frozen=True, eq=False)
class Problem:
    """Geometry, law and prescribed motion of a simulation.

    Attributes:
        element: what its cells are, n nodes and n_gauss points each.
        cells: connectivity in VTK order, (n_cells, n).
        n_nodes: number of nodes.
        gradients: shape gradients turned into the crystal [1/µm], (n_cells, n_gauss, n, 3).
        weights: Gauss weights [µm³], (n_cells, n_gauss).
        points: the crystal law at the Gauss points.
        pattern: sparsity of the stiffness on the free degrees of freedom.
        prescribed: prescribed degrees of freedom 3·node + component.
        motion: their displacement at each instant [µm], (n_times, n_prescribed).
        pulled: degrees of freedom whose sum of internal forces is the answered force.
        pull: at each Gauss point its weight times the gradient of a unit motion of the pulled
            face along Y, turned as H, (n_points, 9).
        near_pulled: Gauss points where that is not null.
        length: extent of the specimen along Y [µm].
        state: state of the Gauss points at rest, (n_points, n_state).
        strained: whether that state holds an eigenstrain, or a direction changes one.
        dilatation: how the dilatation of the cells is projected, None where it is left alone.
    """

    element: Element
    cells: IntArray
    n_nodes: int
    gradients: FloatArray
    weights: FloatArray
    points: Points
    pattern: Pattern
    prescribed: IntArray
    motion: FloatArray
    pulled: IntArray
    pull: FloatArray
    near_pulled: IntArray
    length: float
    state: FloatArray
    strained: bool
    dilatation: Dilatation | None

    def strain(self, u: FloatArray) -> FloatArray:
        """Return H at the Gauss points (n_points, 9) of a displacement (n_nodes, 3)."""
        H = np.empty((self.points.grain.size, 9))
        displacement_gradients(u, self.cells, self.gradients, H)
        if self.dilatation is not None:
            self.dilatation.project(H)
        return H

    def strain_directions(self, du: FloatArray, dH: FloatArray) -> None:
        """Set dH (n_points, 9, k) to H of the motions du (n_nodes, 3, k)."""
        direction_gradients(du, self.cells, self.gradients, dH)
        if self.dilatation is not None:
            self.dilatation.project_directions(dH)

    def forces(self, P: FloatArray) -> FloatArray:
        """Return the nodal forces [µN] (3·n_nodes,) of stresses P (n_points, 9)."""
        if self.dilatation is not None:
            P = P.copy()
            self.dilatation.project(P)
        forces = np.empty(self.pattern.dofs.shape)
        element_forces(P, self.gradients, self.weights, forces)
        return self.pattern.node_sum(forces, self.n_nodes)


@dataclass(frozen=True, eq=False)
class Tangents:
    """All directions of a simulation in the discrete terms of its problem, k directions.

    Attributes:
        law: derivative of the law at the Gauss points.
        state: derivative of the state at rest, (n_points, n_derived, k).
        motion: derivative of the prescribed motion, (n_times, n_prescribed, k).
        geometric: the directions that move nodes or turn crystals.
        gradients: derivative of the turned shape gradients for those, (g, n_cells, n_gauss, n, 3).
        weighted: derivative of their products with the weights, same shape.
        lengthening: relative change of the length of each interval, (n_times - 1, k).
        longer_step: change of the constants of each grain that does what a relatively longer
            step does, (n_grains, 17).
        dilatation: derivatives of the map of the dilatation along `geometric`; None where that is
            left alone, or nothing is geometric.
    """

    law: PointTangents
    state: FloatArray
    motion: FloatArray
    geometric: IntArray
    gradients: FloatArray
    weighted: FloatArray
    lengthening: FloatArray
    longer_step: FloatArray
    dilatation: DilatationChanges | None

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(self.law.local.shape[1])

    def law_over(self, interval: int) -> PointTangents:
        """Return the derivative of the steps of an interval, each of which keeps its share."""
        longer = self.lengthening[interval]
        if not longer.any():
            return self.law
        change = longer[:, None] * self.longer_step[:, None]
        return replace(self.law, local=self.law.local + change)


def build_problem(simulation: Simulation) -> Problem:
    """Discretise a simulation.

    Raises:
        ValueError: a cell of the mesh is inverted, or of a kind that has no element.
    """
    mesh = simulation.mesh
    element = element_of(mesh.cells, simulation.tet10_points)
    gradients, weights = shape_gradients(mesh.points, mesh.cells, element)
    frames = crystal_frames(simulation, element)
    turned = _turn(gradients, frames.rotation, frames.of_point)
    mask = np.zeros(3 * len(mesh.points), dtype=np.bool_)
    dofs = 3 * simulation.motion_nodes[:, None] + np.arange(3)
    mask[dofs[simulation.motion_mask]] = True
    start = at_rest(simulation, element, frames)
    strained = simulation.material.eigenstrain != 0.0 or any(
        "eigenstrain" in direction.material for direction in simulation.directions
    )
    pulled = 3 * mesh.nodes["S_PLUS"] + 1
    unit = np.zeros((len(mesh.points), 3))
    unit.ravel()[pulled] = 1.0
    pull = np.empty((weights.size, 9))
    displacement_gradients(unit, mesh.cells, turned, pull)
    dilatation = None
    if simulation.mean_dilatation:
        dilatation = mean_dilatation(
            element.dilatation, gradients, weights, frames.rotation, frames.of_point
        )
        dilatation.project(pull)
    pull *= weights.reshape(-1, 1)
    return Problem(
        element=element,
        cells=mesh.cells,
        n_nodes=len(mesh.points),
        gradients=turned,
        weights=weights,
        points=replace(
            points_of_grains(
                simulation.material,
                simulation.integration,
                np.repeat(mesh.grain, weights.shape[1]),
                simulation.orientations,
            ),
            frame_of=frames.of_point,
            rotation=frames.rotation,
            skin=start.skin,
        ),
        pattern=stiffness_pattern(mesh.cells, mask),
        prescribed=dofs[simulation.motion_mask],
        motion=np.ascontiguousarray(simulation.motion[:, simulation.motion_mask]),
        pulled=pulled,
        pull=pull,
        near_pulled=np.flatnonzero(pull.any(axis=1)),
        length=float(np.ptp(mesh.points[:, 1])),
        state=start.state,
        strained=strained,
        dilatation=dilatation,
    )


def build_tangents(simulation: Simulation, problem: Problem) -> Tangents:
    """Put the directions of a simulation into the terms of its problem."""
    mesh, k = simulation.mesh, len(simulation.directions)
    points = problem.points
    frames = Frames(points.rotation, points.frame_of)
    local = np.zeros((mesh.n_grains, k, points.local.shape[1]))
    motion = np.zeros((*problem.motion.shape, k))
    rotations, skins = [np.zeros_like(points.rotation)], [np.zeros_like(points.skin)]
    turn, skinned = np.zeros((mesh.n_grains, k), dtype=np.int64), np.zeros(k, dtype=np.int64)
    grain_of = np.zeros(len(points.rotation), dtype=np.int64)
    grain_of[points.frame_of] = points.grain
    geometric, gradients, weighted = [], [], []
    weight_changes, turns = [], []
    lengthening = np.zeros((len(simulation.times) - 1, k))
    starts = np.zeros((*problem.state.shape, k))
    plain, _ = shape_gradients(mesh.points, mesh.cells, problem.element)
    for index, direction in enumerate(simulation.directions):
        for name, rate in direction.material.items():
            if not acts_at_rest(name):
                local[:, index] += rate * local_tangent(simulation.material, mesh.n_grains, name)
        if direction.motion is not None:
            motion[:, :, index] = direction.motion[:, simulation.motion_mask]
        if direction.times is not None:
            lengthening[:, index] = np.diff(direction.times) / np.diff(simulation.times)
        moves = direction.points is not None
        if (
            direction.rotation is not None
            or direction.lattice_gradient is not None
            or (moves and len(points.rotation) > mesh.n_grains)
        ):
            turned = frame_change(simulation, problem.element, direction)
            turn[np.unique(grain_of[turned.any(axis=(1, 2))]), index] = len(rotations)
            rotations.append(turned)
        rotation = rotations[turn[:, index].max()]
        change = at_rest_change(simulation, problem.element, direction, frames, rotation)
        if change is not None:
            starts[:, :, index] = change.state
            skinned[index] = len(skins)
            skins.append(change.skin)
        if turn[:, index].any() or moves:
            geometric.append(index)
            change_of_gradients, weight_change = _geometric_change(
                direction, plain, problem, mesh.cells, rotation
            )
            gradients.append(change_of_gradients)
            weight_changes.append(weight_change)
            turns.append(rotation)
            of_weights = weight_change[..., None, None] * problem.gradients
            weighted.append(problem.weights[..., None, None] * change_of_gradients + of_weights)
    dilatation = None
    if problem.dilatation is not None and geometric:
        dilatation = dilatation_changes(
            problem.element.dilatation, problem.weights, weight_changes, turns, points.frame_of
        )
    law = PointTangents(local, turn, points.frame(np.array(rotations)), skinned, np.array(skins))
    shape = problem.gradients.shape
    return Tangents(
        law=law,
        state=np.ascontiguousarray(starts[:, : points.n_derived(problem.state.shape[1])]),
        motion=motion,
        geometric=np.array(geometric, dtype=np.int64),
        gradients=np.array(gradients).reshape(len(geometric), *shape),
        weighted=np.array(weighted).reshape(len(geometric), *shape),
        lengthening=lengthening,
        longer_step=longer_step_tangent(points.local),
        dilatation=dilatation,
    )


def _turn(gradients: FloatArray, rotation: FloatArray, frame_of: IntArray) -> FloatArray:
    """Gradients (n_cells, n_gauss, n, 3) in the crystal axes of their points."""
    of_points = rotation[frame_of].reshape(*gradients.shape[:2], 3, 3)
    return np.ascontiguousarray(gradients @ of_points)


def _geometric_change(
    direction: Direction,
    plain: FloatArray,
    problem: Problem,
    cells: IntArray,
    rotation: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    frame_of = problem.points.frame_of
    change = _turn(plain, rotation, frame_of)
    weight_change = np.zeros_like(problem.weights)
    if direction.points is not None:
        moved, weight_change = shape_gradient_velocity(
            plain, problem.weights, cells, direction.points
        )
        change += _turn(moved, problem.points.rotation, frame_of)
    return change, weight_change

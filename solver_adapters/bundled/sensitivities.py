"""Direct differentiation of converged steps along the directions of a simulation."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.equilibrium import Equilibrium, Trial
from solver_adapters.bundled.fem.assembly import (
    add_force_changes,
    add_gradient_changes,
    direction_forces,
    direction_gradients,
    displacement_gradients,
)
from solver_adapters.bundled.fem.problem import Tangents
from solver_adapters.bundled.fem.state import Instant
from solver_adapters.bundled.law.gauss_points import PointTangents


class Differentiation:
    """Differentiates the steps of one problem, one after the other."""

    def __init__(self, equilibrium: Equilibrium, tangents: Tangents) -> None:
        self.problem = equilibrium.problem
        self.tangents = tangents
        self._equilibrium = equilibrium
        # Memory that is used again, since fresh memory has to be cleared.
        n_derived = tangents.state.shape[1]
        self._memory = self.problem.points.memory(tangents.count, n_derived)
        self._states = (self._memory.state, np.empty_like(self._memory.state))
        self._gradients = np.empty_like(self._memory.stress)
        self._kept = self._latest = tangents.state
        # A grain that turns leaves the cells of the other one alone.
        moved, weighted = tangents.gradients, tangents.weighted
        self._changed = np.asarray(moved.any(axis=(2, 3, 4)) | weighted.any(axis=(2, 3, 4)))

    def keep(self, instant: Instant) -> None:
        """Leave the derivatives of this instant, and no longer those of another, untouched.

        Those of another instant are gone with the next step, which carries them on in their place:
        most of a state does not change over a step, and what does not is not copied.
        """
        self._kept = instant.dstate

    def derive(
        self,
        instant: Instant,
        trial: Trial,
        dt: float,
        motion_tangent: FloatArray,
        law: PointTangents,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return derivatives of displacement, states and force at the end of a converged step.

        Those of the states at its start are gone with it unless they are kept.

        1. explicit change of the forces at fixed free displacements;
        2. K du = −change on the free degrees of freedom;
        3. what du adds to the states and to the pulled force.
        """
        p, t = self.problem, self.tangents
        self._equilibrium.assemble(trial, t.count)
        clock = time.perf_counter()
        du = np.zeros((p.n_nodes, 3, t.count))
        flat = du.reshape(3 * p.n_nodes, t.count)
        flat[p.prescribed] = motion_tangent
        dH = self._gradients
        self._strain_change(trial.u, du, dH)
        out = replace(self._memory, state=self._changeable(instant.dstate))
        p.points.derive(trial.H, instant.state, trial.state, trial.slips, dt, dH, law, out)
        change = self._force_change(trial, out.stress)
        clock = self._equilibrium.statistics.clock("derivatives", clock)
        follows = self._equilibrium.solve(trial, -change[p.pattern.free])
        clock = time.perf_counter()
        flat[p.prescribed] = 0.0
        flat[p.pattern.free] = follows
        p.strain_directions(du, dH)
        out.follow(dH)
        # Virtual work of the pulled force: a unit motion of the pulled face against the stress.
        near = p.near_pulled
        pulled = p.pull[near, None] @ trial.C[near]
        added = (pulled @ dH[near])[:, 0].sum(axis=0)
        dforce = change[p.pulled].sum(axis=0) + added
        flat[p.prescribed] = motion_tangent
        self._equilibrium.statistics.clock("derivatives", clock)
        return du, out.state, dforce

    def _changeable(self, dstate: FloatArray) -> FloatArray:
        """Return these derivatives where they may be changed: in place, or a copy of kept ones.

        Raises:
            ValueError: they were not kept, and later steps have changed them.
        """
        kept = dstate is self._kept
        if not kept and dstate is not self._latest and self._is_own(dstate):
            raise ValueError("derivatives of an instant that was not kept and has been overtaken")
        if kept or not self._is_own(dstate):
            free = next(s for s in self._states if not np.may_share_memory(s, self._kept))
            np.copyto(free, dstate)
            dstate = free
        # Another view for each step, so that those of an earlier one are known.
        self._latest = dstate.view()
        return self._latest

    def _is_own(self, dstate: FloatArray) -> bool:
        return any(np.may_share_memory(dstate, state) for state in self._states)

    def _strain_change(self, u: FloatArray, du: FloatArray, dH: FloatArray) -> None:
        """Set dH to the derivative of H where the motion and the geometry change.

        Args:
            u: displacement, (n_nodes, 3).
            du: its derivative, (n_nodes, 3, k).
            dH: filled, (n_points, 9, k).
        """
        p, t = self.problem, self.tangents
        direction_gradients(du, p.cells, p.gradients, dH)
        add_gradient_changes(u, p.cells, t.gradients, self._changed, t.geometric, dH)
        if p.dilatation is None:
            return
        p.dilatation.project_directions(dH)
        if t.dilatation is not None:
            H = np.empty((p.points.grain.size, 9))
            displacement_gradients(u, p.cells, p.gradients, H)
            p.dilatation.add_changes(H, t.dilatation, self._changed, t.geometric, dH)

    def _force_change(self, trial: Trial, dP: FloatArray) -> FloatArray:
        """Return the change of the nodal forces by that of the stress and of the geometry.

        Args:
            trial: the converged step.
            dP: derivative of its stress, left as it is, (n_points, 9, k).
        """
        p, t = self.problem, self.tangents
        P = trial.P
        if p.dilatation is not None:
            dP, P = dP.copy(), P.copy()
            p.dilatation.project_directions(dP)
            if t.dilatation is not None:
                p.dilatation.add_changes(P, t.dilatation, self._changed, t.geometric, dP)
            p.dilatation.project(P)
        forces = np.empty((*p.pattern.dofs.shape, t.count))
        direction_forces(dP, p.gradients, p.weights, forces)
        add_force_changes(P, t.weighted, self._changed, t.geometric, forces)
        return p.pattern.node_sums(forces, p.n_nodes)

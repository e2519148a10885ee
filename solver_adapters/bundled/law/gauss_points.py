"""All Gauss points of a mesh at once: update, tangent and directional derivatives."""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property
from importlib import import_module
from types import ModuleType

import numpy as np

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.bundled.law.law import (
    P_A1,
    P_C2,
    P_LATENT,
    P_Q,
    STRAIN_MODES,
    StateLayout,
    SystemModes,
    local_parameters,
    system_modes,
)
from solver_adapters.constants import interaction_matrix
from solver_adapters.crystal import SYSTEM_COUNTS
from solver_adapters.interface import Integration
from solver_adapters.material import Material, StrainMeasure

# Parts in which the strain of a step is applied where the whole of it finds no solution.
_CONTINUATION = 8

_PACKAGES = dict(zip(SYSTEM_COUNTS, ("law", "law.of_48"), strict=True))


def point_kernels_of(n_systems: int) -> ModuleType:
    """Return `point_kernels` of so many slip systems, one of `SYSTEM_COUNTS`."""
    return import_module(f"solver_adapters.bundled.{_PACKAGES[n_systems]}.point_kernels")


@dataclass(frozen=True, eq=False)
class PointSolution:
    """A step solved at all points.

    Attributes:
        state: states at its end, (n_points, n_state).
        slips: slips S Δp of the step, (n_points, n_systems).
        P: first Piola–Kirchhoff stress times the crystal rotation [MPa], (n_points, 9).
        C: tangent ∂P/∂H, (n_points, 9, 9).
        iterations: negative where the law found no solution, (n_points,).
    """

    state: FloatArray
    slips: FloatArray
    P: FloatArray
    C: FloatArray
    iterations: IntArray

    def put(self, where: IntArray, part: PointSolution) -> None:
        """Replace what stands for some points."""
        for item in fields(self):
            getattr(self, item.name)[where] = getattr(part, item.name)


@dataclass(frozen=True, eq=False)
class PointDerivatives:
    """Derivatives of a solved step along k directions, in memory that is used again.

    Attributes:
        stress: derivative of P [MPa], (n_points, 9, k).
        state: derivative of the state, (n_points, `Points.n_derived`, k).
        by_slip: ∂Δp/∂H of the systems that move, (n_points, 9, n_systems).
        by_state: ∂/∂H of the nine kinematic numbers, (n_points, 9, 9).
        gains: derivative of x, S v, p and x2 of a system by its slip, (n_points, 4, n_systems), 0
            at rest.
    """

    stress: FloatArray
    state: FloatArray
    by_slip: FloatArray
    by_state: FloatArray
    gains: FloatArray

    def follow(self, dH: FloatArray) -> None:
        """Add what a further dH (n_points, 9, k) changes to the state."""
        kernels = point_kernels_of(self.gains.shape[2])
        kernels.follow(self.by_slip, self.by_state, self.gains, dH, self.state)


@dataclass(frozen=True, eq=False)
class PointTangents:
    """How the law of each Gauss point moves along k directions.

    Attributes:
        local: derivative of the local constants, shape (n_grains, k, 17).
        turn: for each direction the row of `frame` that holds its part of the points of a grain,
            0 for none, (n_grains, k).
        frame: `Points.frame` of the derivative of the rotations, the first row null,
            (1 + n, n_frames, ...).
        skinned: for each direction the row of `skin`, 0 for none, (k,).
        skin: derivative of the factors on τ0, the first row null, (1 + m, n_points).
    """

    local: FloatArray
    turn: IntArray
    frame: FloatArray
    skinned: IntArray
    skin: FloatArray

    @cached_property
    def changes(self) -> BoolArray:
        """Whether a direction changes a constant of the law of a grain, (n_grains, k)."""
        return np.asarray(np.any(self.local != 0.0, axis=2))

    @cached_property
    def asked(self) -> BoolArray:
        """Whether any direction changes a constant of the law of a grain, (n_grains, 17)."""
        return np.asarray(np.any(self.local != 0.0, axis=1))


@dataclass(frozen=True, eq=False)
class Points:
    """The crystal law at all Gauss points of a mesh.

    Attributes:
        strain_measure: "small" or "finite".
        exponential: whether the exponential scheme is used rather than backward Euler (`law`).
        grain: row of `local` of each point, shape (n_points,).
        local: constants of each grain, shape (n_grains, 17), see `law.local_parameters`.
        frame_of: row of `rotation` of each point, shape (n_points,).
        rotation: crystal → specimen rotations, shape (n_frames, 3, 3).
        skin: factor on τ0 of each point, shape (n_points,).
        systems: the slip systems.
        interaction: interaction matrix, shape (n_systems, n_systems).
    """

    strain_measure: StrainMeasure
    exponential: bool
    grain: IntArray
    local: FloatArray
    frame_of: IntArray
    rotation: FloatArray
    skin: FloatArray
    systems: SystemModes
    interaction: FloatArray

    @property
    def n_systems(self) -> int:
        """Number of slip systems, null ones included."""
        return len(self.systems.tensors)

    @property
    def layout(self) -> StateLayout:
        """Layout of the state of a point."""
        return StateLayout(self.n_systems)

    @property
    def coupled(self) -> bool:
        """Whether slip on one system hardens others."""
        latent = bool(np.any(self.local[:, P_LATENT]))
        diagonal = np.array_equal(self.interaction, np.eye(self.n_systems))
        return latent or (bool(np.any(self.local[:, P_Q])) and not diagonal)

    @property
    def unsymmetric(self) -> bool:
        """Whether the tangent is not symmetric."""
        return self.coupled or bool(np.any(self.local[:, P_A1] != 0.0))

    def n_derived(self, n_state: int) -> int:
        """How many numbers of a state of `n_state` have derivatives that matter."""
        follows = bool(np.any(self.local[:, [P_Q, P_LATENT, P_C2]]))
        return n_state if follows else self.layout.accumulated

    def frame(self, rotation: FloatArray) -> FloatArray:
        """Return what a kernel needs of rotations or their derivatives (..., 3, 3).

        Strain modes turned into the specimen (..., 6, 9) in small strain, else (..., 9).
        """
        if self.strain_measure == "finite":
            return np.ascontiguousarray(rotation.reshape(*rotation.shape[:-2], 9))
        modes = np.einsum("...ij,kjl->...kil", rotation, STRAIN_MODES)
        return np.ascontiguousarray(modes.reshape(*modes.shape[:-2], 9))

    @cached_property
    def _frame(self) -> FloatArray:
        return self.frame(self.rotation)

    def update(
        self,
        H: FloatArray,
        state0: FloatArray,
        guess: FloatArray,
        dt: float,
        H0: FloatArray | None = None,
    ) -> PointSolution:
        """Solve a step of length dt [s].

        Where the iteration fails from the guess it starts from rest; where that fails too and H0
        is given, from the solutions for growing parts of the strain of the step.

        Args:
            H: displacement gradient times the crystal rotation, (n_points, 9).
            state0: state at the start, (n_points, n_state).
            guess: slips of the step to start from, (n_points, n_systems).
            dt: length of the step [s].
            H0: H at the start of the step, (n_points, 9), or None.
        """
        solution = self._solve(slice(None), H, state0, guess, dt)
        failed = np.flatnonzero(solution.iterations < 0)
        if failed.size:
            solution.put(failed, self._solve(failed, H, state0, np.zeros_like(guess), dt))
            failed = np.flatnonzero(solution.iterations < 0)
        if failed.size and H0 is not None:
            slips = np.zeros_like(guess)
            for part in range(1, _CONTINUATION + 1):
                share = part / _CONTINUATION
                again = self._solve(failed, H0 + share * (H - H0), state0, slips, dt)
                slips[failed] = again.slips
            solution.put(failed, again)
        return solution

    def _solve(
        self,
        which: slice | IntArray,
        H: FloatArray,
        state0: FloatArray,
        guess: FloatArray,
        dt: float,
    ) -> PointSolution:
        H, state0, guess = H[which], state0[which], guess[which]
        n = H.shape[0]
        state1, slips, P = np.empty_like(state0), np.empty((n, self.n_systems)), np.empty((n, 9))
        C, count = np.empty((n, 9, 9)), np.empty(n, dtype=np.int64)
        finite = self.strain_measure == "finite"
        kernels = point_kernels_of(self.n_systems)
        run = kernels.update_finite if finite else kernels.update_small
        run(
            self.grain[which],
            self.frame_of[which],
            self._frame,
            self.local,
            self.skin[which],
            self.systems.schmid,
            self.systems.conjugate,
            self.systems.sense,
            self.interaction,
            self.exponential,
            self.coupled,
            H,
            state0,
            guess,
            dt,
            state1,
            slips,
            P,
            C,
            count,
        )
        return PointSolution(state1, slips, P, C, count)

    def memory(self, k: int, n_derived: int) -> PointDerivatives:
        """Memory for derivatives along k directions."""
        n = self.grain.size
        return PointDerivatives(
            np.empty((n, 9, k)),
            np.empty((n, n_derived, k)),
            np.empty((n, 9, self.n_systems)),
            np.empty((n, 9, 9)),
            np.empty((n, 4, self.n_systems)),
        )

    def derive(
        self,
        H: FloatArray,
        state0: FloatArray,
        state1: FloatArray,
        slips: FloatArray,
        dt: float,
        dH: FloatArray,
        tangents: PointTangents,
        out: PointDerivatives,
    ) -> None:
        """Return the derivatives of a solved step along k directions.

        Args:
            H: as in `update`.
            state0: as in `update`.
            state1: state at the end of the step, (n_points, n_state).
            slips: converged slips of the step, (n_points, n_systems).
            dt: as in `update`.
            dH: derivative of H, (n_points, 9, k).
            tangents: derivative of the law.
            out: filled; its state is that at the start, and becomes that at the end.
        """
        finite = self.strain_measure == "finite"
        kernels = point_kernels_of(self.n_systems)
        run = kernels.derive_finite if finite else kernels.derive_small
        run(
            self.grain,
            self.frame_of,
            self._frame,
            self.local,
            self.skin,
            self.systems.schmid,
            self.systems.conjugate,
            self.systems.sense,
            self.interaction,
            self.exponential,
            self.coupled,
            H,
            state0,
            state1,
            slips,
            dt,
            dH,
            tangents.turn,
            tangents.frame,
            tangents.local,
            tangents.changes,
            tangents.asked,
            tangents.skinned,
            tangents.skin,
            out.state,
            out.stress,
            out.by_slip,
            out.by_state,
            out.gains,
        )


def points_of_grains(
    material: Material, integration: Integration, grain: IntArray, rotation: FloatArray
) -> Points:
    """Points whose law changes from grain to grain only.

    Args:
        material: constants.
        integration: scheme of the time integration.
        grain: grain of each point, (n_points,).
        rotation: crystal → specimen rotation of each grain, (n_grains, 3, 3).
    """
    return Points(
        material.strain_measure,
        integration == "exponential",
        grain,
        local_parameters(material, len(rotation)),
        grain,
        rotation,
        np.ones(grain.size),
        system_modes(material.slip_systems),
        interaction_matrix(material),
    )

"""All Gauss points of a mesh at once: update, tangent and directional derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from solver_adapters.bundled import finite_strain, slip, small_strain
from solver_adapters.bundled.compilation import batch_kernel
from solver_adapters.bundled.law import (
    CONJUGATE_MODES,
    NS,
    P_A1,
    P_LATENT,
    P_Q,
    S_ACC,
    S_X,
    S_X2,
    SCHMID_MODES,
    STRAIN_MODES,
    TWINNING_SENSE,
    interaction_matrix,
    local_parameters,
)
from solver_adapters.interface import Integration
from solver_adapters.material import Material, StrainMeasure

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Slip by which a solved system may be wrong.
SLIP_TOLERANCE = 1e-13
MOST_ITERATIONS = 60
# Parts in which the strain of a step is applied where the whole of it finds no solution.
_CONTINUATION = 8
_CHUNKS = 16
_small_update, _small_store = small_strain.update, small_strain.store
_small_tangent, _small_derivative = small_strain.tangent, small_strain.derivative
_small_prepare, _SMALL_SIZE = small_strain.prepare, small_strain.WORKSPACE
_finite_update, _finite_store = finite_strain.update, finite_strain.store
_finite_tangent, _finite_derivative = finite_strain.tangent, finite_strain.derivative
_small_response, _finite_response = small_strain.response, finite_strain.response
_prepare_derivatives, _slip_gains = slip.prepare_derivatives, slip.slip_gains
_finite_prepare, _FINITE_SIZE = finite_strain.prepare, finite_strain.WORKSPACE


@batch_kernel
def _update_small(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    guess: FloatArray,
    dt: float,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
    C: FloatArray,
    count: IntArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_SMALL_SIZE)
        _small_prepare(w, SCHMID_MODES, CONJUGATE_MODES, interaction, TWINNING_SENSE)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            V = frame[frame_of[i]]
            p = local[grain[i]]
            count[i] = _small_update(
                w,
                H[i],
                V,
                p,
                skin[i],
                dt,
                exponential,
                coupled,
                state0[i],
                guess[i],
                SLIP_TOLERANCE,
                MOST_ITERATIONS,
            )
            _small_store(w, V, p, state0[i], state1[i], slips[i], P[i])
            _small_tangent(w, V, p, C[i])


@batch_kernel
def _update_finite(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    guess: FloatArray,
    dt: float,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
    C: FloatArray,
    count: IntArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_FINITE_SIZE)
        _finite_prepare(w, SCHMID_MODES, CONJUGATE_MODES, interaction, TWINNING_SENSE)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            p = local[grain[i]]
            count[i] = _finite_update(
                w,
                H[i],
                frame[frame_of[i]],
                p,
                skin[i],
                dt,
                exponential,
                coupled,
                state0[i],
                guess[i],
                SLIP_TOLERANCE,
                MOST_ITERATIONS,
            )
            _finite_store(w, state1[i], slips[i], P[i])
            _finite_tangent(w, p, C[i])


@batch_kernel
def _derive_small(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_SMALL_SIZE)
        _small_prepare(w, SCHMID_MODES, CONJUGATE_MODES, interaction, TWINNING_SENSE)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            g, f = grain[i], frame_of[i]
            _small_update(
                w,
                H[i],
                frame[f],
                local[g],
                skin[i],
                dt,
                exponential,
                coupled,
                state0[i],
                slips[i],
                0.0,
                0,
            )
            _prepare_derivatives(w, local[g], exponential)
            _small_response(w, frame[f], local[g], coupled, by_slip[i], by_state[i])
            _slip_gains(w, local[g], exponential, gains[i])
            for k in range(dH.shape[1]):
                _small_derivative(
                    w,
                    H[i],
                    frame[f],
                    local[g],
                    skin[i],
                    dt,
                    exponential,
                    coupled,
                    dH[i, k],
                    turn[k] > 0,
                    dframe[turn[k], f],
                    dlocal[g, k],
                    dskin[skinned[k], i],
                    dstate0[i, k],
                    dP[i, k],
                    dstate1[i, k],
                )


@batch_kernel
def _derive_finite(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_FINITE_SIZE)
        _finite_prepare(w, SCHMID_MODES, CONJUGATE_MODES, interaction, TWINNING_SENSE)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            g, f = grain[i], frame_of[i]
            _finite_update(
                w,
                H[i],
                frame[f],
                local[g],
                skin[i],
                dt,
                exponential,
                coupled,
                state0[i],
                slips[i],
                0.0,
                0,
            )
            _prepare_derivatives(w, local[g], exponential)
            _finite_response(w, local[g], coupled, by_slip[i], by_state[i])
            _slip_gains(w, local[g], exponential, gains[i])
            for k in range(dH.shape[1]):
                _finite_derivative(
                    w,
                    local[g],
                    skin[i],
                    dt,
                    exponential,
                    coupled,
                    dH[i, k],
                    dframe[turn[k], f],
                    dlocal[g, k],
                    dskin[skinned[k], i],
                    dstate0[i, k],
                    dP[i, k],
                    dstate1[i, k],
                )


@batch_kernel
def _follow(
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
    dH: FloatArray,
    dstate: FloatArray,
) -> None:
    fields = (dstate.shape[2] - S_X) // NS
    for i in prange(dH.shape[0]):
        moved = np.empty(NS)
        for k in range(dH.shape[1]):
            # Sums written out: a call of np.sum would make an array for each.
            h = dH[i, k]
            for j in range(9):
                b = by_state[i, j]
                dstate[i, k, j] += (
                    b[0] * h[0] + b[1] * h[1] + b[2] * h[2] + b[3] * h[3] + b[4] * h[4]
                    + b[5] * h[5] + b[6] * h[6] + b[7] * h[7] + b[8] * h[8]
                )  # fmt: skip
            for s in range(NS):
                b = by_slip[i, s]
                moved[s] = (
                    b[0] * h[0] + b[1] * h[1] + b[2] * h[2] + b[3] * h[3] + b[4] * h[4]
                    + b[5] * h[5] + b[6] * h[6] + b[7] * h[7] + b[8] * h[8]
                )  # fmt: skip
            for field in range(fields):
                for s in range(NS):
                    dstate[i, k, S_X + NS * field + s] += gains[i, field, s] * moved[s]


@dataclass(frozen=True, eq=False)
class Following:
    """How the state at the end of a step follows the displacement gradient.

    Attributes:
        slip: ∂Δp/∂H, (n_points, 24, 9).
        kinematic: derivative of the nine kinematic numbers, (n_points, 9, 9).
        gains: derivative of x, S v, p and x2 of a system by its slip, (n_points, 4, 24).
    """

    slip: FloatArray
    kinematic: FloatArray
    gains: FloatArray

    def add(self, dH: FloatArray, dstate: FloatArray) -> None:
        """Add what dH (n_points, k, 9) changes to derivatives (n_points, k, n) of the state."""
        _follow(self.slip, self.kinematic, self.gains, dH, dstate)


@dataclass(frozen=True, eq=False)
class PointTangents:
    """How the law of each Gauss point moves along k directions.

    Attributes:
        local: derivative of the local constants, shape (n_grains, k, 16).
        turn: for each direction the row of `rotation` that holds its part, 0 for none, (k,).
        rotation: derivative of the rotations, the first row null, (1 + n, n_frames, 3, 3).
        skinned: for each direction the row of `skin`, 0 for none, (k,).
        skin: derivative of the factors on τ0, the first row null, (1 + m, n_points).
    """

    local: FloatArray
    turn: IntArray
    rotation: FloatArray
    skinned: IntArray
    skin: FloatArray


@dataclass(frozen=True, eq=False)
class Points:
    """The crystal law at all Gauss points of a mesh.

    Attributes:
        strain_measure: "small" or "finite".
        exponential: whether the exponential scheme is used rather than backward Euler (`law`).
        grain: row of `local` of each point, shape (n_points,).
        local: constants of each grain, shape (n_grains, 16), see `law.local_parameters`.
        frame_of: row of `rotation` of each point, shape (n_points,).
        rotation: crystal → specimen rotations, shape (n_frames, 3, 3).
        skin: factor on τ0 of each point, shape (n_points,).
        interaction: interaction matrix, shape (24, 24).
    """

    strain_measure: StrainMeasure
    exponential: bool
    grain: IntArray
    local: FloatArray
    frame_of: IntArray
    rotation: FloatArray
    skin: FloatArray
    interaction: FloatArray

    def initial_state(self) -> FloatArray:
        """State of the crystal at rest, without a second back strain, shape (n_points, 81)."""
        state = np.zeros((self.grain.size, S_X2))
        if self.strain_measure == "finite":
            state[:, [0, 4, 8]] = 1.0
        return state

    @property
    def coupled(self) -> bool:
        """Whether slip on one system hardens others."""
        hardens = bool(np.any(self.local[:, P_Q] != 0.0))
        diagonal = np.array_equal(self.interaction, np.eye(NS))
        return hardens and not (diagonal and not np.any(self.local[:, P_LATENT]))

    @property
    def unsymmetric(self) -> bool:
        """Whether the tangent is not symmetric."""
        return self.coupled or bool(np.any(self.local[:, P_A1] != 0.0))

    def n_derived(self, n_state: int) -> int:
        """How many numbers of a state of `n_state` have derivatives that matter."""
        return n_state if np.any(self.local[:, P_Q]) or n_state > S_X2 else S_ACC

    def frame(self, rotation: FloatArray) -> FloatArray:
        """What a kernel needs of rotations or their derivatives (..., 3, 3).

        Strain modes turned into the specimen (..., 6, 9) in small strain, else (..., 9).
        """
        if self.strain_measure == "finite":
            return np.ascontiguousarray(rotation.reshape(*rotation.shape[:-2], 9))
        modes = np.einsum("...ij,kjl->...kil", rotation, STRAIN_MODES)
        return np.ascontiguousarray(modes.reshape(*modes.shape[:-2], 9))

    def update(
        self,
        H: FloatArray,
        state0: FloatArray,
        guess: FloatArray,
        dt: float,
        H0: FloatArray | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """Solve a step of length dt [s].

        Where the iteration fails from the guess it starts from rest; where that fails too and H0
        is given, from the solutions for growing parts of the strain of the step.

        Args:
            H: displacement gradient times the crystal rotation, (n_points, 9).
            state0: state at the start, (n_points, n_state).
            guess: slips of the step to start from, (n_points, 24).
            dt: length of the step [s].
            H0: H at the start of the step, (n_points, 9), or None.

        Returns:
            state (n_points, n_state), slips (n_points, 24), stress times rotation [MPa]
            (n_points, 9), tangent ∂P/∂H (n_points, 9, 9), iterations (n_points,), negative where
            not converged.
        """
        solution = self._solve(slice(None), H, state0, guess, dt)
        count = solution[-1]
        failed = np.flatnonzero(count < 0)
        if failed.size:
            again = self._solve(failed, H, state0, np.zeros_like(guess), dt)
            _put(solution, failed, again)
            failed = np.flatnonzero(count < 0)
        if failed.size and H0 is not None:
            slips = np.zeros_like(guess)
            for part in range(1, _CONTINUATION + 1):
                share = part / _CONTINUATION
                again = self._solve(failed, H0 + share * (H - H0), state0, slips, dt)
                slips[failed] = again[1]
            _put(solution, failed, again)
        return solution

    def _solve(
        self,
        which: slice | IntArray,
        H: FloatArray,
        state0: FloatArray,
        guess: FloatArray,
        dt: float,
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        H, state0, guess = H[which], state0[which], guess[which]
        n = H.shape[0]
        state1, slips, P = np.empty_like(state0), np.empty((n, NS)), np.empty((n, 9))
        C, count = np.empty((n, 9, 9)), np.empty(n, dtype=np.int64)
        run = _update_finite if self.strain_measure == "finite" else _update_small
        run(
            self.grain[which],
            self.frame_of[which],
            self.frame(self.rotation),
            self.local,
            self.skin[which],
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
        return state1, slips, P, C, count

    def derive(
        self,
        H: FloatArray,
        state0: FloatArray,
        slips: FloatArray,
        dt: float,
        dH: FloatArray,
        tangents: PointTangents,
        dstate0: FloatArray,
    ) -> tuple[FloatArray, FloatArray, Following]:
        """Derivatives of a solved step along k directions.

        Args:
            H: as in `update`.
            state0: as in `update`.
            dt: as in `update`.
            slips: converged slips of the step, (n_points, 24).
            dH: derivative of H, (n_points, k, 9).
            tangents: derivative of the law.
            dstate0: derivative of the state at the start, (n_points, k, `n_derived`).

        Returns:
            derivatives of P (n_points, k, 9) and of the state (n_points, k, `n_derived`), and how
            the state follows any further dH.
        """
        dP, dstate1, n = np.empty(dH.shape), np.empty(dstate0.shape), dH.shape[0]
        following = Following(np.empty((n, NS, 9)), np.empty((n, 9, 9)), np.empty((n, 4, NS)))
        run = _derive_finite if self.strain_measure == "finite" else _derive_small
        run(
            self.grain,
            self.frame_of,
            self.frame(self.rotation),
            self.local,
            self.skin,
            self.interaction,
            self.exponential,
            self.coupled,
            H,
            state0,
            slips,
            dt,
            dH,
            tangents.turn,
            self.frame(tangents.rotation),
            tangents.local,
            tangents.skinned,
            tangents.skin,
            dstate0,
            dP,
            dstate1,
            following.slip,
            following.kinematic,
            following.gains,
        )
        return dP, dstate1, following


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
        interaction_matrix(material),
    )


def _put(
    solution: tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray],
    where: IntArray,
    part: tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray],
) -> None:
    for whole, piece in zip(solution, part, strict=True):
        whole[where] = piece

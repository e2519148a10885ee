"""All Gauss points of a mesh at once: update, tangent and directional derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from solver_adapters.bundled import finite_strain, small_strain
from solver_adapters.bundled.compilation import batch_kernel
from solver_adapters.bundled.law import (
    N_STATE,
    NS,
    SCHMID_MODES,
    STRAIN_MODES,
)
from solver_adapters.material import StrainMeasure

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SLIP_TOLERANCE = 1e-11
MOST_ITERATIONS = 60
_CHUNKS = 16
_small_update, _small_store = small_strain.update, small_strain.store
_small_tangent, _small_derivative = small_strain.tangent, small_strain.derivative
_small_prepare, _SMALL_SIZE = small_strain.prepare, small_strain.WORKSPACE
_finite_update, _finite_store = finite_strain.update, finite_strain.store
_finite_tangent, _finite_derivative = finite_strain.tangent, finite_strain.derivative
_finite_prepare, _FINITE_SIZE = finite_strain.prepare, finite_strain.WORKSPACE


@batch_kernel
def _update_small(
    grain: IntArray,
    frame: FloatArray,
    local: FloatArray,
    H: FloatArray,
    state0: FloatArray,
    guess: FloatArray,
    dt: float,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
    C: FloatArray,
    count: IntArray,
    table: FloatArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_SMALL_SIZE)
        _small_prepare(w, table)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            V = frame[grain[i]]
            p = local[grain[i]]
            count[i] = _small_update(
                w, H[i], V, p, dt, state0[i], guess[i], SLIP_TOLERANCE, MOST_ITERATIONS
            )
            _small_store(w, V, p, state0[i], state1[i], slips[i], P[i])
            _small_tangent(w, V, p, C[i])


@batch_kernel
def _update_finite(
    grain: IntArray,
    frame: FloatArray,
    local: FloatArray,
    H: FloatArray,
    state0: FloatArray,
    guess: FloatArray,
    dt: float,
    state1: FloatArray,
    slips: FloatArray,
    P: FloatArray,
    C: FloatArray,
    count: IntArray,
    table: FloatArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_FINITE_SIZE)
        _finite_prepare(w, table)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            p = local[grain[i]]
            count[i] = _finite_update(
                w,
                H[i],
                frame[grain[i]],
                p,
                dt,
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
    frame: FloatArray,
    local: FloatArray,
    H: FloatArray,
    state0: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    table: FloatArray,
) -> None:
    n = H.shape[0]
    turned = np.zeros(dframe.shape[:2], dtype=np.bool_)
    for g in range(dframe.shape[0]):
        for k in range(dframe.shape[1]):
            turned[g, k] = np.any(dframe[g, k] != 0.0)
    for chunk in prange(_CHUNKS):
        w = np.zeros(_SMALL_SIZE)
        _small_prepare(w, table)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            g = grain[i]
            _small_update(w, H[i], frame[g], local[g], dt, state0[i], slips[i], 0.0, 0)
            for k in range(dH.shape[1]):
                _small_derivative(
                    w,
                    H[i],
                    frame[g],
                    local[g],
                    dt,
                    dH[i, k],
                    turned[g, k],
                    dframe[g, k],
                    dlocal[g, k],
                    dstate0[i, k],
                    dP[i, k],
                    dstate1[i, k],
                )


@batch_kernel
def _derive_finite(
    grain: IntArray,
    frame: FloatArray,
    local: FloatArray,
    H: FloatArray,
    state0: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    table: FloatArray,
) -> None:
    n = H.shape[0]
    for chunk in prange(_CHUNKS):
        w = np.zeros(_FINITE_SIZE)
        _finite_prepare(w, table)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            g = grain[i]
            _finite_update(w, H[i], frame[g], local[g], dt, state0[i], slips[i], 0.0, 0)
            for k in range(dH.shape[1]):
                _finite_derivative(
                    w,
                    local[g],
                    dt,
                    dH[i, k],
                    dframe[g, k],
                    dlocal[g, k],
                    dstate0[i, k],
                    dP[i, k],
                    dstate1[i, k],
                )


@dataclass(frozen=True, eq=False)
class Points:
    """The crystal law at all Gauss points of a mesh.

    Attributes:
        strain_measure: "small" or "finite".
        grain: grain of each point, shape (n_points,).
        local: constants of each grain, shape (n_grains, 11), see `law.local_parameters`.
        rotation: crystal → specimen rotation of each grain, shape (n_grains, 3, 3).
    """

    strain_measure: StrainMeasure
    grain: IntArray
    local: FloatArray
    rotation: FloatArray

    def initial_state(self) -> FloatArray:
        """State of the undeformed crystal, shape (n_points, 57)."""
        state = np.zeros((self.grain.size, N_STATE))
        if self.strain_measure == "finite":
            state[:, [0, 4, 8]] = 1.0
        return state

    def frame(self, rotation: FloatArray) -> FloatArray:
        """What a kernel needs of rotations (or their derivatives), (..., 3, 3) → (..., k[, 9])."""
        if self.strain_measure == "finite":
            return np.ascontiguousarray(rotation.reshape(*rotation.shape[:-2], 9))
        modes = np.einsum("...ij,kjl->...kil", rotation, STRAIN_MODES)
        return np.ascontiguousarray(modes.reshape(*modes.shape[:-2], 9))

    def update(
        self, H: FloatArray, state0: FloatArray, guess: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
        """Solve a step of length dt [s].

        Args:
            H: displacement gradient times the crystal rotation, (n_points, 9).
            state0: state at the start, (n_points, 57).
            guess: slips of the step to start from, (n_points, 24).
            dt: length of the step [s].

        Returns:
            state (n_points, 57), slips (n_points, 24), stress times rotation [MPa] (n_points, 9),
            tangent ∂P/∂H (n_points, 9, 9), iterations (n_points,; negative: not converged).
        """
        n = H.shape[0]
        state1, slips, P = np.empty_like(state0), np.empty((n, NS)), np.empty((n, 9))
        C, count = np.empty((n, 9, 9)), np.empty(n, dtype=np.int64)
        run = _update_finite if self.strain_measure == "finite" else _update_small
        run(
            self.grain,
            self.frame(self.rotation),
            self.local,
            H,
            state0,
            guess,
            dt,
            state1,
            slips,
            P,
            C,
            count,
            SCHMID_MODES,
        )
        return state1, slips, P, C, count

    def derive(
        self,
        H: FloatArray,
        state0: FloatArray,
        slips: FloatArray,
        dt: float,
        dH: FloatArray,
        drotation: FloatArray,
        dlocal: FloatArray,
        dstate0: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Derivatives of a solved step along k directions.

        Args:
            H: as in `update`.
            state0: as in `update`.
            dt: as in `update`.
            slips: converged slips of the step, (n_points, 24).
            dH: derivative of H, (n_points, k, 9).
            drotation: derivative of the rotations, (n_grains, k, 3, 3).
            dlocal: derivative of the local constants, (n_grains, k, 11).
            dstate0: derivative of the state at the start, (n_points, k, 57).

        Returns:
            derivatives of P (n_points, k, 9) and of the state (n_points, k, 57).
        """
        dP, dstate1 = np.empty(dH.shape), np.empty(dstate0.shape)
        run = _derive_finite if self.strain_measure == "finite" else _derive_small
        run(
            self.grain,
            self.frame(self.rotation),
            self.local,
            H,
            state0,
            slips,
            dt,
            dH,
            self.frame(drotation),
            dlocal,
            dstate0,
            dP,
            dstate1,
            SCHMID_MODES,
        )
        return dP, dstate1

"""Loops over the Gauss points of a mesh, compiled: update, derivatives, what follows from them."""

import numpy as np
from numba import prange
from numpy.typing import NDArray

from solver_adapters.bundled import (
    finite_derivative,
    finite_strain,
    slip_derivatives,
    small_derivative,
    small_strain,
)
from solver_adapters.bundled.compilation import batch_kernel
from solver_adapters.bundled.law import CONJUGATE_MODES, NS, S_X, SCHMID_MODES, TWINNING_SENSE

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

# Slip by which a solved system may be wrong.
SLIP_TOLERANCE = 1e-13
MOST_ITERATIONS = 60
_CHUNKS = 16
_small_update, _small_store = small_strain.update, small_strain.store
_small_tangent, _small_prepare = small_strain.tangent, small_strain.prepare
_small_response, _small_derivative = small_derivative.response, small_derivative.derivative
_finite_update, _finite_store = finite_strain.update, finite_strain.store
_finite_tangent, _finite_prepare = finite_strain.tangent, finite_strain.prepare
_finite_response, _finite_derivative = finite_derivative.response, finite_derivative.derivative
_prepare_derivatives = slip_derivatives.prepare_derivatives
_slip_gains = slip_derivatives.slip_gains
_SMALL_SIZE, _FINITE_SIZE = small_strain.WORKSPACE, finite_strain.WORKSPACE


@batch_kernel
def update_small(
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
    """Solve a step at each point, small strain: see `Points.update`."""
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
def update_finite(
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
    """Solve a step at each point, finite strain: see `Points.update`."""
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
def derive_small(
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
    constant: BoolArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    """Derivatives of a solved step, small strain: see `Points.derive`."""
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
                    constant[k],
                    dH[i, k],
                    turn[k] > 0,
                    dframe[turn[k], f],
                    dlocal[g, k],
                    dskin[skinned[k], i],
                    dstate0[i, k],
                    gains[i],
                    dP[i, k],
                    dstate1[i, k],
                )


@batch_kernel
def derive_finite(
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
    constant: BoolArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate0: FloatArray,
    dP: FloatArray,
    dstate1: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    """Derivatives of a solved step, finite strain: see `Points.derive`."""
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
                    constant[k],
                    dH[i, k],
                    dframe[turn[k], f],
                    dlocal[g, k],
                    dskin[skinned[k], i],
                    dstate0[i, k],
                    gains[i],
                    dP[i, k],
                    dstate1[i, k],
                )


@batch_kernel
def follow(
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
    dH: FloatArray,
    dstate: FloatArray,
) -> None:
    """Add to derivatives of the state what a further change of the gradients makes.

    Args:
        by_slip: ∂Δp/∂H, (n_points, 9, 24).
        by_state: derivative of the nine kinematic numbers, (n_points, 9, 9).
        gains: derivative of x, S v, p and x2 of a system by its slip, (n_points, 4, 24).
        dH: (n_points, k, 9).
        dstate: (n_points, k, n), added to.
    """
    fields = (dstate.shape[2] - S_X) // NS
    for chunk in prange(_CHUNKS):
        n = dH.shape[0]
        moved = np.empty(NS)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            for k in range(dH.shape[1]):
                h0, h1, h2 = dH[i, k, 0], dH[i, k, 1], dH[i, k, 2]
                h3, h4, h5 = dH[i, k, 3], dH[i, k, 4], dH[i, k, 5]
                h6, h7, h8 = dH[i, k, 6], dH[i, k, 7], dH[i, k, 8]
                b = by_state[i]
                for m in range(9):
                    dstate[i, k, m] += (
                        b[0, m] * h0 + b[1, m] * h1 + b[2, m] * h2 + b[3, m] * h3 + b[4, m] * h4
                        + b[5, m] * h5 + b[6, m] * h6 + b[7, m] * h7 + b[8, m] * h8
                    )  # fmt: skip
                b = by_slip[i]
                for s in range(NS):
                    moved[s] = (
                        b[0, s] * h0 + b[1, s] * h1 + b[2, s] * h2 + b[3, s] * h3 + b[4, s] * h4
                        + b[5, s] * h5 + b[6, s] * h6 + b[7, s] * h7 + b[8, s] * h8
                    )  # fmt: skip
                for field in range(fields):
                    for s in range(NS):
                        dstate[i, k, S_X + NS * field + s] += gains[i, field, s] * moved[s]

"""Loops over the Gauss points of a mesh, compiled: update, derivatives, what follows from them."""

import numpy as np
from numba import prange

from meshes.arrays import BoolArray, FloatArray, IntArray
from solver_adapters.kernels import batch_kernel, kernel

from . import (
    NS,
    finite_derivative,
    finite_strain,
    slip_derivatives,
    small_derivative,
    small_strain,
)
from .simd_rows import LANES
from .state_layout import S_X

# Slip by which a solved system may be wrong.
SLIP_TOLERANCE = 1e-13
MOST_ITERATIONS = 60
_CHUNKS = 16
_small_update, _small_store = small_strain.update, small_strain.store
_small_tangent, _small_prepare = small_strain.tangent, small_strain.prepare
_small_response, _small_derivatives = small_derivative.response, small_derivative.derivatives
_small_constants, _finite_constants = small_derivative.constants, finite_derivative.constants
_finite_update, _finite_store = finite_strain.update, finite_strain.store
_finite_tangent, _finite_prepare = finite_strain.tangent, finite_strain.prepare
_finite_response, _finite_derivatives = finite_derivative.response, finite_derivative.derivatives
_prepare_derivatives = slip_derivatives.prepare_derivatives
_moving_systems = slip_derivatives.moving_systems
_slip_gains = slip_derivatives.slip_gains
_SMALL_SIZE, _FINITE_SIZE = small_strain.WORKSPACE, finite_strain.WORKSPACE
_SMALL_LANES, _FINITE_LANES = small_derivative.LANES_SIZE, finite_derivative.LANES_SIZE


@batch_kernel
def update_small(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    schmid: FloatArray,
    conjugate: FloatArray,
    sense: FloatArray,
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
        _small_prepare(w, schmid, conjugate, interaction, sense)
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
                state1[i],
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
    schmid: FloatArray,
    conjugate: FloatArray,
    sense: FloatArray,
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
        _finite_prepare(w, schmid, conjugate, interaction, sense)
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
                state1[i],
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
    schmid: FloatArray,
    conjugate: FloatArray,
    sense: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    state1: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    changes: BoolArray,
    asked: BoolArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate: FloatArray,
    dP: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    """Derive a solved step, small strain: see `Points.derive`."""
    n, n_directions = H.shape[0], dH.shape[2]
    blocks = (n_directions + LANES - 1) // LANES
    for chunk in prange(_CHUNKS):
        w, b, moving = np.zeros(_SMALL_SIZE), np.zeros(_SMALL_LANES), np.zeros(NS, dtype=np.int64)
        _small_prepare(w, schmid, conjugate, interaction, sense)
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
                state1[i],
                0.0,
                0,
            )
            _prepare_derivatives(w, local[g], exponential)
            _slip_gains(w, local[g], exponential, gains[i])
            count = _moving_systems(w, moving)
            _small_response(
                w, b, moving, count, frame[f], local[g], coupled, by_slip[i], by_state[i]
            )
            if count > 0:
                _small_constants(w, dt, local[g], skin[i], exponential, coupled, asked[g])
            for block in range(blocks):
                first = block * n_directions // blocks
                _small_derivatives(
                    w,
                    b,
                    moving,
                    count,
                    i,
                    H[i],
                    f,
                    frame[f],
                    local[g],
                    exponential,
                    coupled,
                    first,
                    (block + 1) * n_directions // blocks - first,
                    dH[i],
                    turn[g],
                    dframe,
                    dlocal[g],
                    changes[g],
                    skinned,
                    dskin,
                    dstate[i],
                    gains[i],
                    dP[i],
                )


@batch_kernel
def derive_finite(
    grain: IntArray,
    frame_of: IntArray,
    frame: FloatArray,
    local: FloatArray,
    skin: FloatArray,
    schmid: FloatArray,
    conjugate: FloatArray,
    sense: FloatArray,
    interaction: FloatArray,
    exponential: bool,
    coupled: bool,
    H: FloatArray,
    state0: FloatArray,
    state1: FloatArray,
    slips: FloatArray,
    dt: float,
    dH: FloatArray,
    turn: IntArray,
    dframe: FloatArray,
    dlocal: FloatArray,
    changes: BoolArray,
    asked: BoolArray,
    skinned: IntArray,
    dskin: FloatArray,
    dstate: FloatArray,
    dP: FloatArray,
    by_slip: FloatArray,
    by_state: FloatArray,
    gains: FloatArray,
) -> None:
    """Derive a solved step, finite strain: see `Points.derive`."""
    n, n_directions = H.shape[0], dH.shape[2]
    blocks = (n_directions + LANES - 1) // LANES
    for chunk in prange(_CHUNKS):
        w, b, moving = np.zeros(_FINITE_SIZE), np.zeros(_FINITE_LANES), np.zeros(NS, dtype=np.int64)
        _finite_prepare(w, schmid, conjugate, interaction, sense)
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
                state1[i],
                0.0,
                0,
            )
            _prepare_derivatives(w, local[g], exponential)
            _slip_gains(w, local[g], exponential, gains[i])
            count = _moving_systems(w, moving)
            _finite_response(w, b, moving, count, local[g], coupled, by_slip[i], by_state[i])
            if count > 0:
                _finite_constants(w, dt, local[g], skin[i], exponential, coupled, asked[g])
            for block in range(blocks):
                first = block * n_directions // blocks
                _finite_derivatives(
                    w,
                    b,
                    moving,
                    count,
                    i,
                    f,
                    local[g],
                    exponential,
                    coupled,
                    first,
                    (block + 1) * n_directions // blocks - first,
                    dH[i],
                    turn[g],
                    dframe,
                    dlocal[g],
                    changes[g],
                    skinned,
                    dskin,
                    dstate[i],
                    gains[i],
                    dP[i],
                )


@kernel
def _combine(matrix: FloatArray, column: int, h: FloatArray, total: FloatArray) -> None:
    """Set total to the column of a matrix (9, n) times h (9, k)."""
    c0, c1, c2 = matrix[0, column], matrix[1, column], matrix[2, column]
    c3, c4, c5 = matrix[3, column], matrix[4, column], matrix[5, column]
    c6, c7, c8 = matrix[6, column], matrix[7, column], matrix[8, column]
    for k in range(total.size):
        total[k] = (
            c0 * h[0, k] + c1 * h[1, k] + c2 * h[2, k] + c3 * h[3, k] + c4 * h[4, k]
            + c5 * h[5, k] + c6 * h[6, k] + c7 * h[7, k] + c8 * h[8, k]
        )  # fmt: skip


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
        by_slip: ∂Δp/∂H of the systems that move, (n_points, 9, NS).
        by_state: derivative of the nine kinematic numbers, (n_points, 9, 9).
        gains: derivative of x, S v, p and x2 of a system by its slip, (n_points, 4, NS), 0 at rest.
        dH: (n_points, 9, k).
        dstate: (n_points, n, k), added to.
    """
    fields, width = (dstate.shape[1] - S_X) // NS, dH.shape[2]
    for chunk in prange(_CHUNKS):
        n = dH.shape[0]
        moved = np.empty(width)
        for i in range(chunk * n // _CHUNKS, (chunk + 1) * n // _CHUNKS):
            if not np.any(gains[i, 2]):
                continue  # at rest
            h = dH[i]
            for m in range(9):
                if np.any(by_state[i, :, m]):  # in small strain five of them
                    _combine(by_state[i], m, h, moved)
                    for k in range(width):
                        dstate[i, m, k] += moved[k]
            for s in range(NS):
                if gains[i, 2, s] != 0.0:
                    _combine(by_slip[i], s, h, moved)
                    for field in range(fields):
                        gain, row = gains[i, field, s], S_X + NS * field + s
                        for k in range(width):
                            dstate[i, row, k] += gain * moved[k]

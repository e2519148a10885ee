"""What many directions owe to their history, against the complex step of the formulas.

The derivatives of whole points are those of `test_gauss_points`.
"""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray, IntArray
from solver_adapters.bundled.law import NS, slip_derivatives
from solver_adapters.bundled.law import workspace_layout as rows
from solver_adapters.bundled.law.law import P_B, P_C2
from solver_adapters.bundled.law.simd_rows import B_EXPLICIT, B_OVER, B_SLIP_END, B_STEP, LANES
from solver_adapters.bundled.law.state_layout import N_STATE, S_ACC, S_OVER, S_X, S_X2
from tests.solver_adapters.bundled.from_python import FromPython
from tests.solver_adapters.bundled.slip_workspace import (
    ACCUMULATED,
    COUPLED,
    RNG,
    SCHEMES,
    SECOND,
    SIGN,
    SLIP,
    STEP,
    constants,
    hardening,
    row,
    second,
    second_left,
    workspace,
)

kernels = FromPython(slip_derivatives)

FIRST, WIDTH = 2, 5
"""The directions that are looked at: some of those of the arrays, the others have to stay."""


def moving(w: FloatArray) -> tuple[IntArray, int]:
    systems = np.zeros(NS, dtype=np.int64)
    row(w, rows.WEIGHT)[:] = np.where(SLIP > 0.0, RNG.uniform(1e-6, 1e-3, NS), 0.0)
    return systems, kernels.moving_systems(w, systems)


def lanes(b: FloatArray, offset: int, count: int) -> FloatArray:
    return b[offset : offset + LANES * count].reshape(count, LANES)[:, :WIDTH]


def test_the_systems_that_move_are_listed_in_their_order() -> None:
    systems, count = moving(workspace())
    np.testing.assert_array_equal(systems[:count], np.flatnonzero(SLIP > 0.0))


@COUPLED
@SCHEMES
def test_history_acts_through_hardening_both_back_stresses_and_overstress(
    coupled: bool, exponential: bool
) -> None:
    w, p, b = workspace(coupled), constants(coupled), np.full(B_SLIP_END, np.nan)
    systems, count = moving(w)
    dstate = RNG.normal(size=(N_STATE, FIRST + WIDTH + 1))
    row(w, rows.UNHARDENED)[:] = np.exp(-p[P_B] * (ACCUMULATED + SLIP))
    row(w, rows.LEFT2)[:] = second_left(p, exponential)
    row(w, rows.HISTORY)[:], row(w, rows.OVER_GAIN)[:] = RNG.normal(size=(2, NS))
    kernels.history_derivatives(w, b, p, coupled, systems, count, dstate, FIRST, WIDTH)
    s, chosen = systems[:count], dstate[:, FIRST : FIRST + WIDTH]
    over = row(w, rows.OVER_GAIN)[s, None] * chosen[S_OVER + s]
    expected = -row(w, rows.HISTORY)[s, None] * chosen[S_X + s] - over
    for k in range(WIDTH):
        total = ACCUMULATED + SLIP + 1j * STEP * chosen[S_ACC:S_X2, k]
        start = SIGN * (SECOND + 1j * STEP * chosen[S_X2:, k])
        resistance = hardening(p, total, coupled) + p[P_C2] * second(p, start, exponential)
        expected[:, k] -= resistance.imag[s] / STEP
    np.testing.assert_allclose(lanes(b, B_EXPLICIT, count), expected, rtol=1e-9)
    np.testing.assert_array_equal(lanes(b, B_OVER, count), over)


@pytest.mark.parametrize("rows_kept", [S_ACC, S_X2, N_STATE])
def test_a_system_at_rest_loses_its_overstress_and_keeps_all_else(rows_kept: int) -> None:
    w, b = workspace(), RNG.normal(size=B_SLIP_END)
    systems, count = moving(w)
    row(w, rows.OVER0)[:] = np.where(RNG.random(NS) < 0.5, 0.0, 30.0)
    dstate = RNG.normal(size=(rows_kept, FIRST + WIDTH + 1))
    before, gains = dstate.copy(), RNG.normal(size=(4, NS))
    for offset in (rows.LEFT, rows.LEFT2):
        row(w, offset)[:] = RNG.uniform(0.5, 1.0, NS)
    kernels.advance_states(w, b, gains, systems, count, dstate, FIRST, WIDTH)
    expected, chosen = before.copy(), slice(FIRST, FIRST + WIDTH)
    s, step = systems[:count], lanes(b, B_STEP, count)
    lost = np.flatnonzero((SLIP == 0.0) & (row(w, rows.OVER0) != 0.0))
    expected[S_OVER + lost, chosen] = 0.0
    shares = {S_X: row(w, rows.LEFT), S_ACC: np.ones(NS), S_X2: row(w, rows.LEFT2)}
    slopes = {S_X: gains[0], S_ACC: np.ones(NS), S_X2: gains[3]}
    for field, share in shares.items():
        if field < rows_kept:
            moved = share[s, None] * before[field + s, chosen] + slopes[field][s, None] * step
            expected[field + s, chosen] = moved
    speeds = SIGN[s, None] * lanes(b, B_OVER, count) + gains[1][s, None] * step
    expected[S_OVER + s, chosen] = speeds
    np.testing.assert_allclose(dstate, expected, rtol=1e-14, atol=1e-14)

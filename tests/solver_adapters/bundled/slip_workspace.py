"""A workspace of slip systems filled by hand, and formulas that take complex numbers."""

from __future__ import annotations

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.bundled.law import NS
from solver_adapters.bundled.law import workspace_layout as rows
from solver_adapters.bundled.law.law import N_LOCAL, P_A1, P_B, P_C2, P_D2, P_LATENT, P_Q

STEP = 1e-30
RNG = np.random.default_rng(7)
SIGN = RNG.choice([-1.0, 1.0], NS)
SLIP = np.where(RNG.random(NS) < 0.6, 10.0 ** RNG.uniform(-6.0, -2.0, NS), 0.0)
ACCUMULATED = RNG.uniform(0.0, 2e-2, NS)
SECOND = RNG.uniform(-2e-3, 2e-3, NS)
TAU, OTHER = RNG.uniform(-90.0, 90.0, NS), RNG.uniform(-40.0, 40.0, NS)
H = RNG.uniform(0.2, 1.8, (NS, NS))

COUPLED = pytest.mark.parametrize("coupled", [True, False])
SCHEMES = pytest.mark.parametrize("exponential", [True, False], ids=["exponential", "Euler"])


def row(w: FloatArray, offset: int) -> FloatArray:
    return w[offset : offset + NS]


def by_constant(w: FloatArray, constant: int) -> FloatArray:
    return row(w, rows.BY_CONSTANT + NS * constant)


def workspace(coupled: bool = True) -> FloatArray:
    w = np.zeros(rows.N_SLIP_ROWS + 3 * 5 * NS)
    given = {
        rows.SIGN: SIGN, rows.SLIP: SLIP, rows.ACC0: ACCUMULATED, rows.X20: SECOND,
        rows.TAU: TAU, rows.OTHER: OTHER,
    }  # fmt: skip
    for offset, values in given.items():
        row(w, offset)[:] = values
    w[rows.INTERACTION : rows.INTERACTION + NS * NS] = (H if coupled else np.eye(NS)).ravel()
    return w


def constants(coupled: bool = True) -> FloatArray:
    p = np.zeros(N_LOCAL)
    p[[P_Q, P_B, P_C2, P_D2, P_A1]] = 15.0, 40.0, 4000.0, 120.0, 0.3
    p[P_LATENT] = 6.0 if coupled else 0.0
    return p


def moduli(p: FloatArray, coupled: bool) -> FloatArray:
    """Q h and the latent hardening beside its diagonal; alone systems have the identity for h."""
    h = H if coupled else np.eye(NS)
    return np.asarray(p[P_Q] * h + p[P_LATENT] * (1.0 - np.eye(NS)))


def hardening(p: FloatArray, total: FloatArray, coupled: bool) -> FloatArray:
    """Σ_r M_sr (1 − exp(−b p_r)), complex numbers included."""
    return np.asarray(moduli(p, coupled) @ (1.0 - np.exp(-p[P_B] * total)))


def second(p: FloatArray, start: FloatArray, exponential: bool) -> FloatArray:
    """S x2 at the end of the step from S x2 at its start."""
    d, g = p[P_D2], SLIP
    if not exponential:
        return np.asarray((start + g) / (1.0 + d * g))
    return np.asarray(1.0 / d + (start - 1.0 / d) * np.exp(-d * g))


def second_left(p: FloatArray, exponential: bool) -> FloatArray:
    """Share of the second back strain that the step leaves."""
    u = p[P_D2] * SLIP
    return np.asarray(np.exp(-u) if exponential else 1.0 / (1.0 + u))

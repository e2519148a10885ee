"""The crystal law at one Gauss point: constants, layout of parameters and state, local packing.

Over a step of length Δt each active system s slips by Δγ_s = S_s Δp_s, Δp_s > 0, and satisfies,
with everything at the end of the step (backward Euler, stress form),

    S τ_s − c S x_s − r_s − K (Δp_s/Δt)^(1/n) = 0
    x_s = (x_s⁰ + Δγ_s) / (1 + d Δp_s)
    r_s = τ0_s + Q (1 − exp(−b (p_s⁰ + Δp_s)))

In stress form Newton's method needs a few iterations where the rate form, whose slope changes
by ten orders of magnitude, needs tens.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from solver_adapters.crystal import N_110, N_SYSTEMS, schmid_tensors
from solver_adapters.material import Material

FloatArray = NDArray[np.float64]

NS = N_SYSTEMS

# Local parameters of a grain.
P_C11, P_C12, P_C44, P_K, P_N, P_C, P_D, P_Q, P_B, P_TAU110, P_TAU112 = range(11)
N_LOCAL = 11

# State of a point: nine kinematic numbers (small strain: five deviatoric modes of the plastic
# strain; finite strain: Fp⁻¹ row by row), back strains x, accumulated slips p.
S_KIN = 0
S_X = 9
S_ACC = S_X + NS
N_STATE = S_ACC + NS

# Slip below which a system counts as at rest.
SLIP_AT_REST = 1e-15
# Start of a system that has just become active: no more than this slip.
SLIP_START = 1e-6

_R2, _R6, _R3 = 1 / np.sqrt(2.0), 1 / np.sqrt(6.0), 1 / np.sqrt(3.0)
# Orthonormal symmetric tensors in which cubic elasticity is diagonal:
# two with C11 − C12, three with 2 C44, one with C11 + 2 C12.
STRAIN_MODES = np.array(
    [
        [[_R2, 0, 0], [0, -_R2, 0], [0, 0, 0]],
        [[-_R6, 0, 0], [0, -_R6, 0], [0, 0, 2 * _R6]],
        [[0, 0, 0], [0, 0, _R2], [0, _R2, 0]],
        [[0, 0, _R2], [0, 0, 0], [_R2, 0, 0]],
        [[0, _R2, 0], [_R2, 0, 0], [0, 0, 0]],
        [[_R3, 0, 0], [0, _R3, 0], [0, 0, _R3]],
    ]
)

_SPIN_MODES = _R2 * np.array(
    [
        [[0, 0, 0], [0, 0, 1], [0, -1, 0]],
        [[0, 0, 1], [0, 0, 0], [-1, 0, 0]],
        [[0, 1, 0], [-1, 0, 0], [0, 0, 0]],
    ]
)
# Orthonormal tensors without trace: five strains, three spins.
SLIP_MODES = np.concatenate([STRAIN_MODES[:5], _SPIN_MODES])
# Schmid tensors in these modes, mode first, shape (8, 24); small strain needs the first five.
SCHMID_MODES = np.ascontiguousarray(np.einsum("kij,sij->ks", SLIP_MODES, schmid_tensors()))


def local_parameters(material: Material, n_grains: int) -> FloatArray:
    """Constants of each grain in the order of the P_ indices, shape (n_grains, 11)."""
    m = material
    table = np.empty((n_grains, N_LOCAL))
    table[:, P_C11] = m.C11 * m.elastic_scale
    table[:, P_C12] = m.C12 * m.elastic_scale
    table[:, P_C44] = m.C44 * m.elastic_scale * m.C44_scale
    table[:, P_K] = m.K
    table[:, P_N] = m.n
    table[:, P_C] = m.c
    table[:, P_D] = m.d
    table[:, P_Q] = m.Q
    table[:, P_B] = m.b
    ratio = np.ones(n_grains)
    ratio[1:] = m.tau0_grain2
    table[:, P_TAU110] = m.tau0 * ratio
    table[:, P_TAU112] = m.tau0 * ratio * m.tau0_112
    return table


def local_tangent(material: Material, n_grains: int, name: str) -> FloatArray:
    """Derivative of `local_parameters` with respect to one field of the material."""
    m = material
    tangent = np.zeros((n_grains, N_LOCAL))
    ratio = np.ones(n_grains)
    ratio[1:] = m.tau0_grain2
    second = np.zeros(n_grains)
    second[1:] = 1.0
    elastic = np.array([m.C11, m.C12, m.C44 * m.C44_scale])
    columns = [P_C11, P_C12, P_C44]
    if name == "elastic_scale":
        tangent[:, columns] = elastic
    elif name == "C44_scale":
        tangent[:, P_C44] = m.C44 * m.elastic_scale
    elif name in ("C11", "C12"):
        tangent[:, P_C11 if name == "C11" else P_C12] = m.elastic_scale
    elif name == "C44":
        tangent[:, P_C44] = m.elastic_scale * m.C44_scale
    elif name == "tau0":
        tangent[:, P_TAU110] = ratio
        tangent[:, P_TAU112] = ratio * m.tau0_112
    elif name == "tau0_112":
        tangent[:, P_TAU112] = m.tau0 * ratio
    elif name == "tau0_grain2":
        tangent[:, P_TAU110] = m.tau0 * second
        tangent[:, P_TAU112] = m.tau0 * second * m.tau0_112
    else:
        index = {"K": P_K, "n": P_N, "c": P_C, "d": P_D, "Q": P_Q, "b": P_B}[name]
        tangent[:, index] = 1.0
    return tangent


FIRST_112 = N_110

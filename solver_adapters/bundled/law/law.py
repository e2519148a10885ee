"""The crystal law at one Gauss point: constants, layout of parameters, local packing.

Over a step of length Δt each active system s slips by Δγ_s = S_s Δp_s, Δp_s > 0, and satisfies,
with everything at the end of the step (stress form),

    S (τ_s − c x_s − c2 x2_s) + a1 τ'_s − r_s − v_s = 0
    r_s = skin · (τ0_s ∓ asymmetry_s) + Σ_r M_sr (1 − exp(−b p_r))
    M = Q · interaction + latent off the diagonal, latent = Q h_latent + Q_latent

τ' is the shear stress along the sense of slip on the conjugate {110} plane, ∓ the twinning sense.

Back stress and overstress v follow from the slip of the step by one of two schemes:

    backward Euler   x = (x⁰ + Δγ) / (1 + d Δp),   v = K (Δp/Δt)^(1/n)
    exponential      x = S/d + (x⁰ − S/d) exp(−d Δp), which is exact while S stays; and where v
                     falls, Δp/Δt = (v⁰ − v) / ∫_v^v⁰ (K/y)ⁿ dy, which is exact for the relaxation
                     dv/dt ∝ −(v/K)ⁿ of a hold (else v as above)

The length of the step enters as Δt K⁻ⁿ only.

In stress form Newton's method needs a few iterations where the rate form, whose slope changes
by ten orders of magnitude, needs tens.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.constants import elastic_constants, grain_ratios
from solver_adapters.crystal import (
    BCC,
    BCC48,
    N_110,
    N_112,
    SystemTable,
    schmid_tensors,
    slip_systems,
)
from solver_adapters.grain_scalars import grain_of_later_ratio
from solver_adapters.material import Material

# Local parameters of a grain.
P_C11, P_C12, P_C44, P_K, P_N, P_C, P_D, P_Q, P_B, P_TAU110, P_TAU112 = range(11)
# τ0 of {112} in the antitwinning sense less that in the twinning sense, halved.
P_ASYMMETRY = 11
# P_LATENT: what slip on one system hardens every other one by [MPa].
P_A1, P_LATENT, P_C2, P_D2 = 12, 13, 14, 15
P_TAU123 = 16
N_LOCAL = 17

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
FIRST_112, FIRST_123 = N_110, N_110 + N_112


@dataclass(frozen=True)
class StateLayout:
    """Where the parts of the state of a point begin.

    Nine kinematic numbers (small strain: five deviatoric modes of the plastic strain; finite
    strain: Fp⁻¹ row by row), back strains x, signed overstresses S v at the end of the last step,
    accumulated slips p, second back strains. What comes last can be left out of derivatives where
    it has no effect.

    Attributes:
        n_systems: number of slip systems.
    """

    n_systems: int

    @property
    def x(self) -> int:
        """Back strains."""
        return 9

    @property
    def over(self) -> int:
        """Signed overstresses."""
        return self.x + self.n_systems

    @property
    def accumulated(self) -> int:
        """Accumulated slips."""
        return self.over + self.n_systems

    @property
    def x2(self) -> int:
        """Second back strains."""
        return self.accumulated + self.n_systems

    @property
    def size(self) -> int:
        """Numbers of a whole state."""
        return self.x2 + self.n_systems


@dataclass(frozen=True, eq=False)
class SystemModes:
    """Slip systems as kernels take them, tensors in `SLIP_MODES`, mode first.

    Small strain needs the first five modes.

    Attributes:
        tensors: Schmid tensors in crystal axes, shape (n_systems, 3, 3).
        schmid: the same in modes, shape (8, n_systems).
        conjugate: tensors of the conjugate {110} planes, null for other systems,
            shape (8, n_systems).
        sense: +1 where positive slip shears a {112} system in the twinning sense, −1 against, 0 for
            other systems, shape (n_systems,).
    """

    tensors: FloatArray
    schmid: FloatArray
    conjugate: FloatArray
    sense: FloatArray


@cache
def system_modes(table: SystemTable) -> SystemModes:
    """Return the slip systems of a table as kernels take them."""
    tensors = schmid_tensors(table)
    conjugate, sense = np.zeros_like(tensors), np.zeros(len(tensors))
    if table in (BCC, BCC48):
        m, n = slip_systems(table)
        # The {110} plane 60° away from n has the normal n/2 + S √3/2 (m × n) for slip of sign S:
        # its part along n scales τ, the rest is √3/2 m ⊗ (m × n).
        across = np.sqrt(0.75) * np.einsum("si,sj->sij", m, np.cross(m, n))
        conjugate[:FIRST_112] = across[:FIRST_112]
        of_112 = slice(FIRST_112, FIRST_123)
        sense[of_112] = np.sign(np.prod(m * n, axis=1))[of_112]
    return SystemModes(tensors, _in_modes(tensors), _in_modes(conjugate), sense)


def _in_modes(tensors: FloatArray) -> FloatArray:
    return np.ascontiguousarray(np.einsum("kij,sij->ks", SLIP_MODES, tensors))


def local_parameters(material: Material, n_grains: int) -> FloatArray:
    """Constants of each grain in the order of the P_ indices, shape (n_grains, 17)."""
    m = material
    table = np.empty((n_grains, N_LOCAL))
    table[:, [P_C11, P_C12, P_C44]] = elastic_constants(m)
    for name, index in _DIRECT.items():
        table[:, index] = getattr(m, name)
    table[:, P_LATENT] = m.Q * m.h_latent + m.Q_latent
    tau0 = m.tau0 * grain_ratios(m, n_grains)
    table[:, P_TAU110] = tau0
    table[:, P_TAU112] = tau0 * m.tau0_112 * (0.5 * (1.0 + m.tau0_antitwinning))
    table[:, P_ASYMMETRY] = tau0 * m.tau0_112 * (0.5 * (m.tau0_antitwinning - 1.0))
    table[:, P_TAU123] = tau0 * m.tau0_123
    return table


_DIRECT = {
    "K": P_K,
    "n": P_N,
    "c": P_C,
    "d": P_D,
    "Q": P_Q,
    "b": P_B,
    "a1": P_A1,
    "Q_latent": P_LATENT,
    "c2": P_C2,
    "d2": P_D2,
}
_ELASTIC = ("C11", "C12", "C44", "elastic_scale", "C44_scale")
_TAU0 = ("tau0", "tau0_112", "tau0_123", "tau0_grain2", "tau0_antitwinning")


def local_tangent(material: Material, n_grains: int, name: str) -> FloatArray:
    """Return the derivative of `local_parameters` with respect to one scalar of the material.

    Shape (n_grains, 17); null for scalars that act otherwise (`fields.acts_at_rest`).
    """
    m = material
    tangent = np.zeros((n_grains, N_LOCAL))
    if name in _DIRECT:
        tangent[:, _DIRECT[name]] = 1.0
        if name == "Q":
            tangent[:, P_LATENT] = m.h_latent
    elif name == "h_latent":
        tangent[:, P_LATENT] = m.Q
    elif name in _ELASTIC:
        scale, share = m.elastic_scale, m.C44_scale
        if name == "elastic_scale":
            tangent[:, [P_C11, P_C12, P_C44]] = m.C11, m.C12, m.C44 * share
        elif name == "C44_scale":
            tangent[:, P_C44] = m.C44 * scale
        elif name == "C44":
            tangent[:, P_C44] = scale * share
        else:
            tangent[:, P_C11 if name == "C11" else P_C12] = scale
    elif name in _TAU0 or grain_of_later_ratio(name) is not None:
        ratio = grain_ratios(m, n_grains)
        first, family, anti = m.tau0, m.tau0_112, m.tau0_antitwinning
        d_family, d_123, d_anti = 0.0, 0.0, 0.0
        d_tau0 = np.zeros(n_grains)
        if name == "tau0":
            d_tau0 = ratio
        elif name == "tau0_112":
            d_family = 1.0
        elif name == "tau0_123":
            d_123 = 1.0
        elif name == "tau0_antitwinning":
            d_anti = 1.0
        else:
            grain = grain_of_later_ratio(name) or 2
            d_tau0[grain - 1 : grain] = first
        tau0 = first * ratio
        d_tau112 = d_tau0 * family + tau0 * d_family
        tangent[:, P_TAU110] = d_tau0
        tangent[:, P_TAU112] = 0.5 * (d_tau112 * (1.0 + anti) + tau0 * family * d_anti)
        tangent[:, P_ASYMMETRY] = 0.5 * (d_tau112 * (anti - 1.0) + tau0 * family * d_anti)
        tangent[:, P_TAU123] = d_tau0 * m.tau0_123 + tau0 * d_123
    return tangent


def longer_step_tangent(local: FloatArray) -> FloatArray:
    """Change of the constants that does to a step what a change of ln Δt does, (n_grains, 17).

    Δt K⁻ⁿ is all that a step knows of its length: d ln K = −d ln Δt / n.

    Args:
        local: constants of each grain, (n_grains, 17).
    """
    tangent = np.zeros_like(local)
    tangent[:, P_K] = -local[:, P_K] / local[:, P_N]
    return tangent

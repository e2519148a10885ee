"""Terms of the general law beyond the baseline: hardening, second back stress, non-Schmid stress.

They are called where their parameter is not null: at null the baseline is computed by the same
operations as if they did not exist.
"""

from meshes.arrays import FloatArray
from solver_adapters.bundled.law.back_strain import gained, growth, recall_slope, share_left
from solver_adapters.bundled.law.fast_math import decay
from solver_adapters.bundled.law.law import (
    FIRST_112,
    P_A1,
    P_B,
    P_C2,
    P_D2,
    P_LATENT,
    P_Q,
    SLIP_AT_REST,
)
from solver_adapters.kernels import kernel

from . import NS
from .workspace_layout import (
    ACC0,
    BY_CONSTANT,
    COUPLED,
    INTERACTION,
    LEFT2,
    OTHER,
    RISE,
    SHIFT,
    SIGN,
    SLIP,
    SLOPE,
    TAU,
    UNHARDENED,
    X2HAT,
    X20,
)


@kernel
def hardens(p: FloatArray) -> bool:
    """Whether slip raises the critical resolved shear stress of any system."""
    return bool(p[P_Q] != 0.0 or p[P_LATENT] != 0.0)


@kernel
def modulus_of(w: FloatArray, p: FloatArray, s: int, r: int) -> float:
    """M_sr: how much slip on system r hardens system s in the end [MPa]; linear in p."""
    modulus: float = p[P_Q] * w[INTERACTION + NS * s + r] + (p[P_LATENT] if s != r else 0.0)
    return modulus


@kernel
def harden(w: FloatArray, p: FloatArray, coupled: bool) -> None:
    """RISE and SLOPE of isotropic hardening; the whole slope matrix goes to COUPLED."""
    if not coupled:
        for s in range(NS):
            rest = decay(p[P_B] * (w[ACC0 + s] + w[SLIP + s]))
            w[RISE + s] = p[P_Q] * (1.0 - rest)
            w[SLOPE + s] = p[P_Q] * p[P_B] * rest
        return
    for s in range(NS):
        w[RISE + s] = 0.0
    for r in range(NS):
        rest = decay(p[P_B] * (w[ACC0 + r] + w[SLIP + r]))
        rise, slope = 1.0 - rest, p[P_B] * rest
        for s in range(NS):
            modulus = modulus_of(w, p, s, r)
            w[RISE + s] += modulus * rise
            w[COUPLED + NS * s + r] = modulus * slope
    for s in range(NS):
        w[SLOPE + s] = w[COUPLED + (NS + 1) * s]


@kernel
def second_back_stress(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """Add c2 S x2 of moving systems to RISE and SLOPE; put that of systems at rest into SHIFT."""
    c, d = p[P_C2], p[P_D2]
    for s in range(NS):
        g = w[SLIP + s]
        moving = g > SLIP_AT_REST
        left = share_left(d * g, exponential)
        start = w[SIGN + s] * w[X20 + s]
        end = start * left + gained(left, g, d, exponential)
        slope = growth(left, start, d, exponential)
        w[X2HAT + s] = end
        w[RISE + s] += c * end if moving else 0.0
        w[SLOPE + s] += c * slope if moving else 0.0
        w[SHIFT + s] = 0.0 if moving else c * w[X20 + s]


@kernel
def schmid_factor(p: FloatArray) -> float:
    """Factor on τ of {110}: the part of the stress on the conjugate plane that is τ itself."""
    factor: float = 1.0 + 0.5 * p[P_A1]
    return factor


@kernel
def driving_modes(
    w: FloatArray, p: FloatArray, schmid: int, conjugate: int, target: int, count: int
) -> None:
    """Tensors whose product with the stress drives slip, in modes (count, NS), at SIGN."""
    for k in range(count):
        for s in range(NS):
            scale = schmid_factor(p) if s < FIRST_112 else 1.0
            other = w[conjugate + k * NS + s]
            w[target + k * NS + s] = scale * w[schmid + k * NS + s] + w[SIGN + s] * p[P_A1] * other


@kernel
def non_schmid(w: FloatArray, p: FloatArray) -> None:
    """Write resolved shear stress and RISE of {110} with the stress on the conjugate planes."""
    factor = schmid_factor(p)
    for s in range(FIRST_112):
        w[TAU + s] *= factor
        w[RISE + s] -= p[P_A1] * w[OTHER + s]


@kernel
def hardening_by_q(w: FloatArray) -> None:
    """Row of Q: h times what slip has saturated.

    Systems without hardening count as uncoupled, but the first of it would be felt by all.
    """
    by = BY_CONSTANT + NS * P_Q
    for s in range(NS):
        total = 0.0
        for r in range(NS):
            total += w[INTERACTION + NS * s + r] * (1.0 - w[UNHARDENED + r])
        w[by + s] = -total


@kernel
def hardening_by_latent(w: FloatArray) -> None:
    """Row of latent hardening: what slip on all other systems has saturated."""
    by, total = BY_CONSTANT + NS * P_LATENT, 0.0
    for r in range(NS):
        total += 1.0 - w[UNHARDENED + r]
    for s in range(NS):
        w[by + s] = 1.0 - w[UNHARDENED + s] - total


@kernel
def hardening_by_b(w: FloatArray, p: FloatArray, coupled: bool) -> None:
    """Row of the rate b of isotropic hardening."""
    by, Q = BY_CONSTANT + NS * P_B, p[P_Q]
    if not coupled:
        for s in range(NS):
            w[by + s] = -Q * w[UNHARDENED + s] * (w[ACC0 + s] + w[SLIP + s])
        return
    for s in range(NS):
        total = 0.0
        for r in range(NS):
            change = w[UNHARDENED + r] * (w[ACC0 + r] + w[SLIP + r])
            total += modulus_of(w, p, s, r) * change
        w[by + s] = -total


@kernel
def second_back_stress_by_c2(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """Row of the modulus of the second back stress."""
    by, d = BY_CONSTANT + NS * P_C2, p[P_D2]
    for s in range(NS):
        start = w[SIGN + s] * w[X20 + s]
        w[by + s] = -(start * w[LEFT2 + s] + gained(w[LEFT2 + s], w[SLIP + s], d, exponential))


@kernel
def second_back_stress_by_d2(w: FloatArray, p: FloatArray, exponential: bool) -> None:
    """Row of the recall of the second back stress."""
    by, c, d = BY_CONSTANT + NS * P_D2, p[P_C2], p[P_D2]
    for s in range(NS):
        start = w[SIGN + s] * w[X20 + s]
        w[by + s] = -c * recall_slope(w[LEFT2 + s], w[SLIP + s], d, start, exponential)


@kernel
def non_schmid_by_a1(w: FloatArray, p: FloatArray) -> None:
    """Row of a1, with OTHER as it is at the solution."""
    by, half = BY_CONSTANT + NS * P_A1, 0.5 / schmid_factor(p)
    for s in range(NS):
        driven = half * w[SIGN + s] * w[TAU + s] + w[OTHER + s]
        w[by + s] = driven if s < FIRST_112 else 0.0

"""Parameters of the crystal law (docs/method/law.md): unit, null and what each may be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from math import inf
from typing import Any, Literal

from solver_adapters.crystal import BCC, BCC48, SystemTable
from solver_adapters.grain_scalars import (
    INSIDE_NULL,
    MODE_SHAPES,
    band_names,
    inside_names,
    later_grain,
    mode_names,
    of_later_grain,
    ratio_name,
)
from solver_adapters.parameter import (
    FINITE,
    GIGAPASCALS,
    NOT_NEGATIVE,
    POSITIVE,
    Parameter,
    Range,
)

StrainMeasure = Literal["small", "finite"]


@dataclass(frozen=True)
class Material:
    """Constants of the Méric–Cailletaud law; the extensions stand at their null values.

    The critical resolved shear stress of system s in grain g at accumulated slips p is
    ``tau0 * grain * family * sense * skin + sum_r (Q * h_sr + latent_sr) * (1 - exp(-b * p_r))``
    with

    - grain: 1 in the first, tau0_grain2 in the second, those of tau0_grains in the later ones;
    - family: tau0_112 of a {112} system, tau0_123 of a {123} system, else 1;
    - sense: tau0_antitwinning where a {112} system slips in the antitwinning sense, else 1;
    - skin: 1 + (skin_tau0 - 1) * exp(-depth / skin_thickness) below the free surface, times
      exp(slope_Y * eta + bend_Y * (3 * eta**2 - 1) / 2 + slope_X * xi + band) inside the grain,
      band its height times 2**-((eta - middle) / half_width)**4;
    - h = interaction + h_latent off the diagonal;
    - latent = Q_latent off the diagonal, else 0.

    Attributes:
        C11, C12, C44: cubic elastic constants [MPa].
        K: viscous stress [MPa·s^(1/n)].
        n: rate exponent [-].
        tau0: initial critical resolved shear stress [MPa].
        c: kinematic modulus [MPa].
        d: recall of the back stress [-].
        Q: saturated isotropic hardening [MPa], null 0.
        b: rate of the isotropic hardening [-], used only where Q or Q_latent is not 0.
        tau0_112: ratio of tau0 on {112}⟨111⟩ to {110}⟨111⟩ [-], null 1.
        tau0_123: ratio of tau0 on {123}⟨111⟩ to {110}⟨111⟩ [-], null 1.
        tau0_grain2: ratio of tau0 in the second grain to the first [-], null 1.
        tau0_grains: ratios of the third and later grains to the first [-]; 1 for those not named.
        tau0_antitwinning: ratio of tau0 on {112} in the antitwinning sense to that in the
            twinning sense [-], null 1.
        a1: non-Schmid factor on {110}: a1 times the shear stress along the slip direction on the
            {110} plane 60° away adds to the resolved shear stress [-], null 0
            (Gröger, Bailey & Vitek, Acta Mater. 56 (2008) 5401).
        h_latent: off-diagonal terms added to the interaction matrix [-], null 0.
        Q_latent: saturated hardening of a system by each other one [MPa], null 0; on top of
            Q h_latent, and there without Q, too.
        slip_systems: plane normal and slip direction of each system, at most 48. Those of BCC
            (`crystal.BCC`, `crystal.BCC48`) are the only ones with families of their own τ0, a
            sense of twinning and a1.
        interaction: interaction matrix, a row and a column for each system [-]; None is the
            identity.
        c2: modulus of a second back stress [MPa], null 0.
        d2: recall of the second back stress [-], used only where c2 is not 0.
        x0: initial back strain of a system whose Schmid factor along Y is 1/2 [-], null 0;
            of others in proportion to theirs.
        eigenstrain: difference of axial eigenstrain (volume-preserving) between the apex line
            and the measured face, linear along Z and without mean [-], null 0.
        skin_tau0: ratio of tau0 at the free surface to that inside [-], null 1.
        skin_thickness: depth over which the ratio fades as exp(−depth/thickness) [µm], used
            only where skin_tau0 is not 1.
        tau0_grain1_slope_Y, tau0_grain1_bend_Y, tau0_grain1_slope_X: modes of ln tau0 inside
            the first grain [-], null 0, over eta along Y and xi along X: the distance from the
            mean of the grain over sqrt(3) standard deviations, -1 to 1 in a uniform bar.
        tau0_grain2_slope_Y, tau0_grain2_bend_Y, tau0_grain2_slope_X: the same of the second.
        tau0_grain1_band: ln tau0 in the middle of a band across the first grain, over that of
            the rest of the grain [-], null 0.
        tau0_grain1_band_middle: eta of its middle [-], used only where the band is not 0.
        tau0_grain1_band_half_width: distance in eta over which it falls to a half [-], used only
            where the band is not 0, or sought.
        tau0_grain2_band, tau0_grain2_band_middle, tau0_grain2_band_half_width: the same of the
            second.
        tau0_grains_inside: the same six of each of the third and later grains, slope_Y, bend_Y,
            slope_X, band, band_middle, band_half_width; their nulls for those not named.
        elastic_scale: factor on all elastic constants [-], null 1.
        C44_scale: factor on C44 alone [-], null 1.
        strain_measure: "small" or "finite".
    """

    C11: float = 233.5e3
    C12: float = 135.5e3
    C44: float = 118e3
    K: float = 12.0
    n: float = 10.0
    tau0: float = 40.0
    c: float = 40e3
    d: float = 1500.0
    Q: float = 0.0
    b: float = 30.0
    tau0_112: float = 1.0
    tau0_123: float = 1.0
    tau0_grain2: float = 1.0
    tau0_grains: tuple[float, ...] = ()
    tau0_antitwinning: float = 1.0
    a1: float = 0.0
    h_latent: float = 0.0
    Q_latent: float = 0.0
    slip_systems: SystemTable = BCC
    interaction: tuple[tuple[float, ...], ...] | None = None
    c2: float = 0.0
    d2: float = 150.0
    x0: float = 0.0
    eigenstrain: float = 0.0
    skin_tau0: float = 1.0
    skin_thickness: float = 0.3
    tau0_grain1_slope_Y: float = 0.0
    tau0_grain1_bend_Y: float = 0.0
    tau0_grain1_slope_X: float = 0.0
    tau0_grain2_slope_Y: float = 0.0
    tau0_grain2_bend_Y: float = 0.0
    tau0_grain2_slope_X: float = 0.0
    tau0_grain1_band: float = 0.0
    tau0_grain1_band_middle: float = 0.0
    tau0_grain1_band_half_width: float = 0.25
    tau0_grain2_band: float = 0.0
    tau0_grain2_band_middle: float = 0.0
    tau0_grain2_band_half_width: float = 0.25
    tau0_grains_inside: tuple[tuple[float, ...], ...] = ()
    elastic_scale: float = 1.0
    C44_scale: float = 1.0
    strain_measure: StrainMeasure = "finite"


MATERIAL_PARAMETERS: tuple[str, ...] = tuple(
    field.name for field in fields(Material) if isinstance(field.default, float)
)
"""Names of the scalars of the law."""

TAU0_MODES: tuple[tuple[str, ...], ...] = tuple(map(mode_names, (1, 2)))
"""Names of the modes of ln τ₀ inside each of the first two grains."""
TAU0_BANDS: tuple[tuple[str, str, str], ...] = tuple(map(band_names, (1, 2)))
"""Names of the band across each of them: its height, its middle, half of its width."""
_SHAPES = tuple(
    f"{form} of ln τ₀ along {axis}" for form, axis in (shape.split("_") for shape in MODE_SHAPES)
)
_OF_CRYSTALS: dict[str, tuple[SystemTable, ...]] = {
    **dict.fromkeys(("tau0_112", "tau0_antitwinning", "a1"), (BCC, BCC48)),
    "tau0_123": (BCC48,),
}


def of_other_crystals(table: SystemTable) -> frozenset[str]:
    """Return the scalars of the law that act on no slip system of a crystal."""
    return frozenset(name for name, have in _OF_CRYSTALS.items() if table not in have)


OF_SECOND_GRAIN = frozenset({ratio_name(2), *inside_names(2)})
"""Scalars of the law that act on nothing in a single grain."""
# Behind each of these the same of the later grains is declared.
_LAST_OF_SECOND = (ratio_name(2), TAU0_MODES[1][-1], TAU0_BANDS[1][-1])


def scalar(material: Material, name: str) -> float:
    """Return a scalar of the law by its name, those of later grains among them."""
    grain = later_grain(name)
    if grain is None:
        return float(getattr(material, name))
    return _of_later_grain(material, grain)[name]


def _of_later_grain(material: Material, grain: int) -> dict[str, float]:
    """Return the scalars of a later grain by name."""
    (ratio,) = material.tau0_grains[grain - 3 : grain - 2] or (1.0,)
    (inside,) = material.tau0_grains_inside[grain - 3 : grain - 2] or (INSIDE_NULL,)
    return {ratio_name(grain): ratio, **dict(zip(inside_names(grain), inside, strict=True))}


def with_parameters(material: Material, values: Mapping[str, float]) -> Material:
    """Return the material with some of its constants replaced; other names are left alone."""
    changes: dict[str, Any] = {name: values[name] for name in MATERIAL_PARAMETERS if name in values}
    later = [grain for grain in map(later_grain, values) if grain is not None]
    if later:
        stated = max(len(material.tau0_grains), len(material.tau0_grains_inside))
        rows = [
            [values.get(name, value) for name, value in _of_later_grain(material, grain).items()]
            for grain in range(3, max(*later, 2 + stated) + 1)
        ]
        changes["tau0_grains"] = _without_last_nulls([ratio for ratio, *_ in rows], 1.0)
        inside = [tuple(row[1:]) for row in rows]
        changes["tau0_grains_inside"] = _without_last_nulls(inside, INSIDE_NULL)
    return replace(material, **changes)


def _without_last_nulls(of_grains: Sequence[Any], null: Any) -> tuple[Any, ...]:
    """Return what later grains have without nulls at the end, which would change keys of jobs."""
    count = max((k for k, one in enumerate(of_grains, start=1) if one != null), default=0)
    return tuple(of_grains[:count])


LEAST_EXPONENT = 1.5
"""Of n in a fit, and in the exponential scheme, whose relaxation has no power law at n = 1."""
# CalculiX has −0.1; below −1 slip would soften others by more than it hardens its own system.
LATENT = Range("-1 or more", -1)
"""Of an entry of the interaction matrix, and of what is added to it."""
_SLOW_STRESS = 10.0  # saturated second back stress that a prior scale of c2 stands for [MPa]


@dataclass(frozen=True)
class Constant:
    """A constant of the law that no fit moves.

    Attributes:
        name: as in `Material`.
        key: dotted key in the case.
        admissible: what it may be.
    """

    name: str
    key: str
    admissible: Range


ELASTIC_CONSTANTS = (
    Constant("C11", "material.C11_GPa", FINITE),
    Constant("C12", "material.C12_GPa", FINITE),
    Constant("C44", "material.C44_GPa", POSITIVE),
)
"""What C11 and C12 may be hangs on each other: `least_C11`."""


def least_C11(C12: float) -> float:
    """Return the bound above which C11 makes the stiffness of a cubic crystal positive definite.

    C11 > |C12| and C11 + 2 C12 > 0, in the unit of C12.
    """
    return max(C12, -2.0 * C12)


def declarations_at(material: Material, n_grains: int = 2) -> tuple[Parameter, ...]:
    """Return the parameters that can be identified or tried, scaled at a case's constants.

    Bounds are those of a fit, and beside them stands what is admissible in a simulation. A back
    strain saturates at 1/d: the scale of x0 is a tenth of it, its bounds are three. The
    scale of c2 is that of a saturated stress c2/d2 of 10 MPa, and the second back stress is
    the slow one, d2 at most d/10 (or what the case says). The rates b and d2 may be 0 in a
    simulation, but not where a diagnosis begins that frees them by their logarithm. A specimen of
    more than two grains has those of the later ones behind those of the second, of the ratio, of
    the modes and of the band.
    """
    declared: list[Parameter] = []
    waiting: list[Parameter] = []
    for parameter in _of_two_grains(material):
        declared.append(parameter)
        waiting += [parameter] if parameter.name in OF_SECOND_GRAIN else []
        if parameter.name in _LAST_OF_SECOND:
            later = range(3, n_grains + 1)
            declared += [of_later_grain(second, grain) for grain in later for second in waiting]
            waiting = []
    return tuple(declared)


def _of_two_grains(material: Material) -> tuple[Parameter, ...]:
    d = max(material.d, 1.0)
    saturated = 1.0 / material.d if material.d > 0 else inf
    back_strain = Range("less than 1/d in size", -saturated, saturated, open=True)
    return (
        Parameter(
            "tau0", "MPa", 40.0, 1.0, 0.1, 2000.0, True, label="τ₀", key="material.tau0_MPa",
            admissible=POSITIVE,
        ),
        Parameter(
            "c", "MPa", 40e3, 1.0, 1.0, 1e7, True, key="material.c_MPa", read_in=GIGAPASCALS,
            admissible=NOT_NEGATIVE,
        ),
        Parameter(
            "d", "", 1500.0, 1.0, 1.0, 1e6, True, key="material.d", admissible=NOT_NEGATIVE
        ),
        Parameter(
            "K", "MPa·s^(1/n)", 12.0, 0.3, 0.1, 1e3, True, key="material.K", admissible=POSITIVE
        ),
        Parameter(
            "n", "", 10.0, 0.3, LEAST_EXPONENT, 60.0, True, key="material.n",
            admissible=Range("one or more", 1),
        ),
        Parameter(
            "Q", "MPa", 0.0, 10.0, 0.0, 2000.0, key="material.Q_MPa", admissible=NOT_NEGATIVE
        ),
        Parameter(
            "b", "", 30.0, 0.47, 1.0, 3000.0, True, key="material.b", admissible=NOT_NEGATIVE,
            startable=POSITIVE,
        ),
        Parameter(
            "tau0_112", "", 1.0, 0.10, 0.3, 3.0, True, label="τ₀ of {112} / τ₀ of {110}",
            key="material.tau0_112", admissible=POSITIVE,
        ),
        Parameter(
            "tau0_123", "", 1.0, 0.10, 0.3, 3.0, True, label="τ₀ of {123} / τ₀ of {110}",
            key="material.tau0_123", admissible=POSITIVE,
        ),
        Parameter(
            "tau0_grain2", "", 1.0, 0.10, 0.3, 3.0, True, label="τ₀ of grain 2 / τ₀ of grain 1",
            key="material.tau0_grain2", admissible=POSITIVE,
        ),
        Parameter(
            "tau0_antitwinning", "", 1.0, 0.10, 0.3, 3.0, True,
            label="τ₀ of {112}, antitwinning / twinning", key="material.tau0_antitwinning",
            admissible=POSITIVE,
        ),
        Parameter(
            "a1", "", 0.0, 0.10, -0.9, 0.9, label="non-Schmid factor a₁", key="material.a1"
        ),
        Parameter(
            "h_latent", "", 0.0, 0.2, -1.0, 10.0, label="latent hardening h",
            key="material.h_latent", admissible=LATENT,
        ),
        Parameter(
            "Q_latent", "MPa", 0.0, 2.0, 0.0, 500.0, label="latent hardening Q",
            key="material.Q_latent_MPa", admissible=NOT_NEGATIVE,
        ),
        Parameter(
            "c2", "MPa", 0.0, _SLOW_STRESS * material.d2, 0.0, 1e6,
            label="c of the second back stress", key="material.c2_MPa", admissible=NOT_NEGATIVE,
        ),
        Parameter(
            "d2", "", 150.0, 0.5, 1.0, max(d / 10, material.d2), True,
            label="d of the second back stress", key="material.d2", admissible=NOT_NEGATIVE,
            startable=POSITIVE,
        ),
        Parameter(
            "x0", "", 0.0, 0.1 / d, -0.3 / d, 0.3 / d, label="initial back strain x₀",
            key="material.x0", admissible=back_strain,
        ),
        Parameter(
            "eigenstrain", "", 0.0, 2e-4, -5e-3, 5e-3, label="eigenstrain, apex less face",
            key="material.eigenstrain",
        ),
        Parameter(
            "skin_tau0", "", 1.0, 0.15, 0.3, 5.0, True, label="τ₀ of the skin / τ₀ inside",
            key="material.skin_tau0", admissible=POSITIVE,
        ),
        Parameter(
            "skin_thickness", "µm", 0.3, 0.5, 0.01, 2.0, True, label="thickness of the skin",
            key="material.skin_thickness_um", admissible=POSITIVE,
        ),
        *(
            Parameter(
                name, "", 0.0, 0.1, -0.7, 0.7, label=f"{shape}, grain {grain}",
                key=f"material.{name}",
            )
            for grain, names in enumerate(TAU0_MODES, start=1)
            for name, shape in zip(names, _SHAPES, strict=True)
        ),
        *(
            parameter
            for grain, names in enumerate(TAU0_BANDS, start=1)
            for parameter in _of_band(grain, *names)
        ),
        Parameter(
            "elastic_scale", "", 1.0, 0.05, 0.3, 3.0, True, label="factor on C₁₁, C₁₂, C₄₄",
            key="material.elastic_scale", admissible=POSITIVE,
        ),
        Parameter(
            "C44_scale", "", 1.0, 0.10, 0.5, 2.0, True, label="factor on C₄₄",
            key="material.C44_scale", admissible=POSITIVE,
        ),
    )  # fmt: skip


def _of_band(grain: int, height: str, middle: str, half_width: str) -> tuple[Parameter, ...]:
    return (
        Parameter(
            height, "", 0.0, 0.1, -1.5, 1.5, label=f"ln τ₀ of the band in grain {grain}",
            key=f"material.{height}",
        ),
        Parameter(
            middle, "", 0.0, 0.5, -1.0, 1.0, key=f"material.{middle}",
            label=f"middle of the band along grain {grain}, −1 to 1",
        ),
        Parameter(
            half_width, "", 0.25, 0.5, 0.05, 0.5, True,
            label=f"width of the band in lengths of grain {grain}", key=f"material.{half_width}",
            admissible=POSITIVE,
        ),
    )  # fmt: skip


MATERIAL_DECLARATIONS: tuple[Parameter, ...] = declarations_at(Material())
"""The same at the constants of the paper."""


def admissible_at(material: Material) -> dict[str, Range]:
    """Return what each scalar of the law may be beside the others of a material."""
    elastic = {constant.name: constant.admissible for constant in ELASTIC_CONSTANTS}
    return elastic | {one.name: one.admissible for one in declarations_at(material)}

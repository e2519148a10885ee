"""Constants of the crystal law in the case file."""

from __future__ import annotations

from collections.abc import Mapping
from math import isfinite
from typing import Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.values import Number, Table
from driver.common.errors import show
from solver_adapters.crystal import BCC, BCC48, FCC, MOST_SYSTEMS, SystemTable, table_fault
from solver_adapters.interaction import bcc24_classes
from solver_adapters.material import (
    ELASTIC_CONSTANTS,
    MATERIAL_DECLARATIONS,
    TAU0_BANDS,
    TAU0_MODES,
    Material,
    admissible_at,
    least_C11,
    of_other_crystals,
)

_INTERACTION = "a row of numbers for each slip system, or for bcc the four numbers [H1, H2, H3, H4]"
_SYSTEMS = (
    f'"bcc", "bcc48", "fcc", or 1 to {MOST_SYSTEMS} systems [[plane normal], [slip direction]], as '
    "[[1, 1, 1], [0, 1, -1]], each direction in its plane"
)


def _matrix_or_classes(value: object) -> object:
    """Refuse what is neither a square matrix of numbers nor the four classes of BCC24."""
    if value is None or _are_numbers(value, 4):
        return value
    if not isinstance(value, (list, tuple)) or not all(isinstance(r, (list, tuple)) for r in value):
        raise refusal(_INTERACTION)
    for place, row in enumerate(value, start=1):
        if not _are_numbers(row, len(row)):
            raise refusal(_INTERACTION, found=f"row {place} as {show(row)}")
        if len(row) != len(value):
            found = f"{len(value)} rows, row {place} of {len(row)} numbers"
            raise refusal(_INTERACTION, found=found)
    return value


def _named_or_listed(value: object) -> object:
    """Refuse what is neither the name of a crystal nor a list of slip systems."""
    if isinstance(value, str):
        if value not in CRYSTALS:
            raise refusal(_SYSTEMS)
        return value
    if not isinstance(value, (list, tuple)):
        raise refusal(_SYSTEMS)
    for place, system in enumerate(value, start=1):
        pair = isinstance(system, (list, tuple)) and len(system) == 2
        if not pair or not all(_are_numbers(indices, 3) for indices in system):
            raise refusal(_SYSTEMS, found=f"system {place} as {show(system)}")
    fault = table_fault(tuple(value))
    if fault is not None:
        raise refusal(_SYSTEMS, found=fault)
    return value


def _are_numbers(value: object, count: int) -> bool:
    """Whether a value is a list of so many finite numbers."""
    return (
        isinstance(value, (list, tuple))
        and len(value) == count
        and all(type(number) in (int, float) and isfinite(number) for number in value)
    )


Matrix = tuple[tuple[Number, ...], ...]
Classes = tuple[Number, Number, Number, Number]
Indices = tuple[Number, Number, Number]
Crystal = Literal["bcc", "bcc48", "fcc"]
SlipSystems = Annotated[
    Literal["bcc", "bcc48", "fcc"] | tuple[tuple[Indices, Indices], ...],
    BeforeValidator(_named_or_listed),
]
CRYSTALS: Mapping[str, SystemTable] = {"bcc": BCC, "bcc48": BCC48, "fcc": FCC}
Ratio = Annotated[float, Field(strict=True, ge=1e-6, le=1e12)]
Interaction = Annotated[Matrix | Classes | None, BeforeValidator(_matrix_or_classes)]


_RATIOS = ("tau0_112", "tau0_123", "tau0_grain2", "tau0_antitwinning")
# What a specimen may carry, in the unit of the key (docs/case-file.md says why). Ratios of τ₀ may
# be so large that the systems they belong to never slip.
_CARRIED: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(("C11_GPa", "C12_GPa"), (-1e4, 1e4)),
    "C44_GPa": (1e-3, 1e4),
    **dict.fromkeys(("tau0_MPa", "K"), (1e-6, 1e6)),
    "n": (1, 1e3),
    **dict.fromkeys(("c_MPa", "c2_MPa"), (0, 1e9)),
    **dict.fromkeys(("Q_MPa", "Q_latent_MPa"), (0, 1e6)),
    **dict.fromkeys(("d", "d2", "b"), (0, 1e7)),
    "h_latent": (-1, 1e3),
    **dict.fromkeys(_RATIOS, (1e-6, 1e12)),
    "a1": (-1, 1),
    "eigenstrain": (-0.1, 0.1),
    "skin_tau0": (1e-3, 1e3),
    "skin_thickness_um": (1e-6, 1e6),
    **dict.fromkeys((*sum(TAU0_MODES, ()), *(band[0] for band in TAU0_BANDS)), (-5, 5)),
    **dict.fromkeys((band[1] for band in TAU0_BANDS), (-1, 1)),
    **dict.fromkeys((band[2] for band in TAU0_BANDS), (0.05, 0.5)),
    **dict.fromkeys(("elastic_scale", "C44_scale"), (1e-3, 1e3)),
}

_BACK_STRAIN = 1.0  # of x0, where d is 0 and nothing saturates

_STARTABLE = {constant.key: constant.admissible for constant in ELASTIC_CONSTANTS} | {
    parameter.key: parameter.startable or parameter.admissible
    for parameter in MATERIAL_DECLARATIONS
}


_CONSTANTS = Material()
_DEFAULTS = {
    constant.key: 1e-3 * getattr(_CONSTANTS, constant.name) for constant in ELASTIC_CONSTANTS
} | {parameter.key: getattr(_CONSTANTS, parameter.name) for parameter in MATERIAL_DECLARATIONS}


def _constant(key: str, description: str) -> Any:
    """Return the field of a constant of the law, with default and bounds of its declaration.

    The description stands in the schema and behind the key in a written case.
    """
    allowed, (lower, upper) = _STARTABLE[f"material.{key}"], _CARRIED[key]
    above: dict[str, Any] = (
        {"gt": lower} if allowed.open and lower == allowed.lower else {"ge": lower}
    )
    default = _DEFAULTS[f"material.{key}"]
    return Field(default=default, description=description, strict=True, le=upper, **above)


class MaterialTable(Table):
    """Constants of the crystal law, `solver_adapters.material.Material` with units in the names."""

    C11_GPa: float = _constant("C11_GPa", "cubic elastic constant")
    C12_GPa: float = _constant("C12_GPa", "cubic elastic constant")
    C44_GPa: float = _constant("C44_GPa", "cubic elastic constant")
    K: float = _constant("K", "viscous stress in MPa·s^(1/n)")
    n: float = _constant("n", "rate exponent")
    tau0_MPa: float = _constant("tau0_MPa", "critical resolved shear stress")
    c_MPa: float = _constant("c_MPa", "kinematic modulus")
    d: float = _constant("d", "recall of the back stress")
    Q_MPa: float = _constant("Q_MPa", "saturated isotropic hardening")
    b: float = _constant("b", "rate of the isotropic hardening")
    h_latent: float = _constant("h_latent", "added to the interaction matrix off its diagonal")
    Q_latent_MPa: float = _constant(
        "Q_latent_MPa", "hardening by each other system, beside Q h; acts where Q is 0, too"
    )
    slip_systems: SlipSystems = Field(default="bcc", description=_SYSTEMS)
    interaction: Interaction = Field(default=None, description=_INTERACTION)
    tau0_112: float = _constant("tau0_112", "ratio of tau0 on {112}<111> to {110}<111>")
    tau0_123: float = _constant("tau0_123", "ratio of tau0 on {123}<111> to {110}<111>")
    tau0_grain2: float = _constant("tau0_grain2", "ratio of tau0 in grain 2 to grain 1")
    tau0_grains: tuple[Ratio, ...] = Field(
        default=(),
        description="ratios of tau0 in the third and later grains to grain 1; 1 for those left out",
    )
    tau0_antitwinning: float = _constant(
        "tau0_antitwinning", "ratio of tau0 on {112}, antitwinning to twinning sense"
    )
    a1: float = _constant(
        "a1", "non-Schmid factor: share of the shear stress on the {110} plane 60° away"
    )
    c2_MPa: float = _constant("c2_MPa", "modulus of a second back stress; none at 0")
    d2: float = _constant("d2", "recall of the second back stress")
    # What x0 may be hangs on d.
    x0: Number = Field(
        default=_CONSTANTS.x0,
        description="back strain before the test of a system of Schmid factor 1/2; below 1/d",
    )
    eigenstrain: float = _constant(
        "eigenstrain", "axial eigenstrain at the apex line less that at the face"
    )
    skin_tau0: float = _constant("skin_tau0", "ratio of tau0 at the free surface to that inside")
    skin_thickness_um: float = _constant("skin_thickness_um", "depth over which skin_tau0 fades")
    tau0_grain1_slope_Y: float = _constant(
        "tau0_grain1_slope_Y", "slope of ln tau0 along Y in grain 1, from its middle to its end"
    )
    tau0_grain1_bend_Y: float = _constant(
        "tau0_grain1_bend_Y", "bend of ln tau0 along Y in grain 1, at its ends"
    )
    tau0_grain1_slope_X: float = _constant(
        "tau0_grain1_slope_X", "slope of ln tau0 along X in grain 1"
    )
    tau0_grain2_slope_Y: float = _constant(
        "tau0_grain2_slope_Y", "slope of ln tau0 along Y in grain 2, from its middle to its end"
    )
    tau0_grain2_bend_Y: float = _constant(
        "tau0_grain2_bend_Y", "bend of ln tau0 along Y in grain 2, at its ends"
    )
    tau0_grain2_slope_X: float = _constant(
        "tau0_grain2_slope_X", "slope of ln tau0 along X in grain 2"
    )
    tau0_grain1_band: float = _constant(
        "tau0_grain1_band", "ln tau0 in a band across grain 1, over that of its rest"
    )
    tau0_grain1_band_middle: float = _constant(
        "tau0_grain1_band_middle", "where its middle is along Y, -1 to 1 over the grain"
    )
    tau0_grain1_band_half_width: float = _constant(
        "tau0_grain1_band_half_width", "half of its width, which is the same share of the grain"
    )
    tau0_grain2_band: float = _constant(
        "tau0_grain2_band", "ln tau0 in a band across grain 2, over that of its rest"
    )
    tau0_grain2_band_middle: float = _constant(
        "tau0_grain2_band_middle", "where its middle is along Y, -1 to 1 over the grain"
    )
    tau0_grain2_band_half_width: float = _constant(
        "tau0_grain2_band_half_width", "half of its width, which is the same share of the grain"
    )
    elastic_scale: float = _constant("elastic_scale", "factor on C11, C12, C44")
    C44_scale: float = _constant("C44_scale", "factor on C44 alone")
    strain_measure: Literal["small", "finite"] = Field(
        default="finite", description="strain measure"
    )

    @model_validator(mode="after")
    def _beside_each_other(self) -> Self:
        if not self.C11_GPa > least_C11(self.C12_GPa):
            least = "C12_GPa" if self.C12_GPa >= 0 else "-2 C12_GPa"
            expected = f"a number > {least} = {least_C11(self.C12_GPa):g} (a stable crystal)"
            raise refusal(expected, "C11_GPa")
        if not abs(self.x0) <= _BACK_STRAIN:
            raise refusal(f"a number from {-_BACK_STRAIN:g} to {_BACK_STRAIN:g}", "x0")
        self._refuse_what_other_crystals_lack()
        back_strain = admissible_at(self.to_material())["x0"]
        if not back_strain.holds(self.x0):
            raise refusal(f"a number smaller in size than 1/d = {back_strain.upper:g}", "x0")
        return self

    added: ClassVar[frozenset[str]] = frozenset(
        {"slip_systems", "tau0_123", "tau0_grains", *sum(TAU0_BANDS, ())}
    )

    def _refuse_what_other_crystals_lack(self) -> None:
        table = self._system_table()
        count = len(table)
        if self.interaction is not None:
            rows, listed = len(self.interaction), isinstance(self.interaction[0], tuple)
            if rows != count if listed else table != BCC:
                found = f"{rows} {'rows' if listed else 'classes'} for {count} slip systems"
                raise refusal(f"{count} rows of {count} numbers", "interaction", found)
        for name in sorted(of_other_crystals(table)):
            value, null = getattr(self, name), getattr(_CONSTANTS, name)
            if value != null:
                have = 'not "bcc48"' if name == "tau0_123" else 'neither "bcc" nor "bcc48"'
                raise refusal(f"{null:g}, for slip_systems is {have}", name)

    def _system_table(self) -> SystemTable:
        if isinstance(self.slip_systems, str):
            return CRYSTALS[self.slip_systems]
        return self.slip_systems

    def to_material(self) -> Material:
        """Return the constants in MPa and s."""
        return Material(
            C11=self.C11_GPa * 1e3, C12=self.C12_GPa * 1e3, C44=self.C44_GPa * 1e3,
            slip_systems=self._system_table(), interaction=self._interaction_matrix(),
            strain_measure=self.strain_measure, tau0_grains=self.tau0_grains,
            **{
                parameter.name: getattr(self, parameter.key.removeprefix("material."))
                for parameter in MATERIAL_DECLARATIONS
            },
        )  # fmt: skip

    def _interaction_matrix(self) -> Matrix | None:
        if self.interaction is None or isinstance(self.interaction[0], tuple):
            return self.interaction
        return tuple(tuple(row) for row in bcc24_classes(*self.interaction).tolist())


COPPER = MaterialTable(slip_systems="fcc", C11_GPa=168.4, C12_GPa=121.4, C44_GPa=75.4, tau0_MPa=20)
"""Copper: elastic constants of Simmons and Wang (1971), and where a fit may begin."""

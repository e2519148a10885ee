"""Constants of the crystal law in the case file."""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.values import NonNegative, Number, Positive, Table
from driver.common.errors import show
from solver_adapters.crystal import N_SYSTEMS
from solver_adapters.interaction import bcc24_classes
from solver_adapters.material import Material

_INTERACTION = f"{N_SYSTEMS} rows of {N_SYSTEMS} numbers, or the four numbers [H1, H2, H3, H4]"


def _matrix_or_classes(value: object) -> object:
    """Refuse what is neither 24 rows of 24 numbers nor the four classes of BCC24."""
    if value is None or _are_numbers(value, 4):
        return value
    if not isinstance(value, (list, tuple)) or not all(isinstance(r, (list, tuple)) for r in value):
        raise refusal(_INTERACTION)
    if len(value) != N_SYSTEMS:
        raise refusal(_INTERACTION, found=f"a list of {len(value)} rows")
    for place, row in enumerate(value, start=1):
        if not _are_numbers(row, N_SYSTEMS):
            raise refusal(_INTERACTION, found=f"row {place} as {show(row)}")
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
Interaction = Annotated[Matrix | Classes | None, BeforeValidator(_matrix_or_classes)]


class MaterialTable(Table):
    """Constants of the crystal law, `solver_adapters.material.Material` with units in the names."""

    C11_GPa: Positive = Field(default=233.5, description="cubic elastic constant")
    C12_GPa: Positive = Field(default=135.5, description="cubic elastic constant")
    C44_GPa: Positive = Field(default=118.0, description="cubic elastic constant")
    K: Positive = Field(default=12.0, description="viscous stress in MPa·s^(1/n)")
    n: Positive = Field(default=10.0, description="rate exponent")
    tau0_MPa: Positive = Field(default=40.0, description="critical resolved shear stress")
    c_MPa: NonNegative = Field(default=40e3, description="kinematic modulus")
    d: NonNegative = Field(default=1500.0, description="recall of the back stress")
    Q_MPa: NonNegative = Field(default=0.0, description="saturated isotropic hardening")
    b: Positive = Field(default=30.0, description="rate of the isotropic hardening")
    h_latent: Number = Field(
        default=0.0, description="added to the interaction matrix off its diagonal"
    )
    Q_latent_MPa: NonNegative = Field(
        default=0.0, description="saturated hardening of a system by each other one, without Q, too"
    )
    interaction: Interaction = Field(default=None, description=_INTERACTION)
    tau0_112: Positive = Field(default=1.0, description="ratio of tau0 on {112} to {110}")
    tau0_grain2: Positive = Field(default=1.0, description="ratio of tau0 in grain 2 to grain 1")
    tau0_antitwinning: Positive = Field(
        default=1.0, description="ratio of tau0 on {112}, antitwinning to twinning sense"
    )
    a1: Number = Field(default=0.0, description="non-Schmid factor on {110}")
    c2_MPa: NonNegative = Field(default=0.0, description="modulus of a second back stress")
    d2: Positive = Field(default=150.0, description="recall of the second back stress")
    x0: Number = Field(default=0.0, description="initial back strain along the loading axis")
    eigenstrain: Number = Field(
        default=0.0, description="difference of axial eigenstrain between apex line and face"
    )
    skin_tau0: Positive = Field(default=1.0, description="ratio of tau0 at the surface to inside")
    skin_thickness_um: Positive = Field(default=0.3, description="depth over which it fades")
    elastic_scale: Positive = Field(default=1.0, description="factor on all elastic constants")
    C44_scale: Positive = Field(default=1.0, description="factor on C44 alone")
    strain_measure: Literal["small", "finite"] = Field(
        default="finite", description="strain measure"
    )

    @model_validator(mode="after")
    def _stable(self) -> Self:
        if self.C11_GPa <= self.C12_GPa:
            raise refusal(f"a number > C12_GPa = {self.C12_GPa:g} (a stable crystal)", "C11_GPa")
        if abs(self.x0) * self.d >= 1:
            raise refusal(f"a number smaller in size than 1/d = {1 / self.d:g}", "x0")
        return self

    def to_material(self) -> Material:
        """Return the constants in MPa and s."""
        return Material(
            C11=self.C11_GPa * 1e3, C12=self.C12_GPa * 1e3, C44=self.C44_GPa * 1e3,
            K=self.K, n=self.n, tau0=self.tau0_MPa, c=self.c_MPa, d=self.d, Q=self.Q_MPa,
            b=self.b, h_latent=self.h_latent, Q_latent=self.Q_latent_MPa,
            interaction=self._interaction_matrix(),
            tau0_112=self.tau0_112, tau0_grain2=self.tau0_grain2,
            tau0_antitwinning=self.tau0_antitwinning, a1=self.a1, c2=self.c2_MPa, d2=self.d2,
            x0=self.x0, eigenstrain=self.eigenstrain, skin_tau0=self.skin_tau0,
            skin_thickness=self.skin_thickness_um,
            elastic_scale=self.elastic_scale, C44_scale=self.C44_scale,
            strain_measure=self.strain_measure,
        )  # fmt: skip

    def _interaction_matrix(self) -> Matrix | None:
        if self.interaction is None or len(self.interaction) != 4:
            return self.interaction
        return tuple(tuple(row) for row in bcc24_classes(*self.interaction).tolist())

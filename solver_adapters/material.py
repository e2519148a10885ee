"""Parameters of the crystal law (docs/method.md), each with its unit and its null value."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Literal

from solver_adapters.parameter import Parameter

StrainMeasure = Literal["small", "finite"]


@dataclass(frozen=True)
class Material:
    """Constants of the Méric–Cailletaud law; the extensions stand at their null values.

    The critical resolved shear stress of system s in grain g at accumulated slip p_s is
    ``tau0 * (tau0_112 if s is a {112} system) * (tau0_grain2 if g is the second grain)
    + Q * (1 - exp(-b * p_s))``.

    Attributes:
        C11, C12, C44: cubic elastic constants [MPa].
        K: viscous stress [MPa·s^(1/n)].
        n: rate exponent [-].
        tau0: initial critical resolved shear stress [MPa].
        c: kinematic modulus [MPa].
        d: recall of the back stress [-].
        Q: saturated isotropic hardening [MPa], null 0.
        b: rate of the isotropic hardening [-], used only where Q is not 0.
        tau0_112: ratio of tau0 on {112}⟨111⟩ to {110}⟨111⟩ [-], null 1.
        tau0_grain2: ratio of tau0 in the second grain to the first [-], null 1.
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
    tau0_grain2: float = 1.0
    elastic_scale: float = 1.0
    C44_scale: float = 1.0
    strain_measure: StrainMeasure = "finite"


MATERIAL_PARAMETERS: tuple[str, ...] = tuple(
    field.name for field in fields(Material) if field.name != "strain_measure"
)


def with_parameters(material: Material, values: Mapping[str, float]) -> Material:
    """The material with some of its constants replaced; other names are left alone."""
    changes = {name: values[name] for name in MATERIAL_PARAMETERS if name in values}
    return Material(**{**asdict(material), **changes})


MATERIAL_DECLARATIONS: tuple[Parameter, ...] = (
    Parameter("tau0", "MPa", 40.0, 1.0, 0.1, 2000.0, True),
    Parameter("c", "MPa", 40e3, 1.0, 1.0, 1e7, True),
    Parameter("d", "", 1500.0, 1.0, 1.0, 1e6, True),
    Parameter("K", "MPa·s^(1/n)", 12.0, 0.3, 0.1, 1e3, True),
    Parameter("n", "", 10.0, 0.3, 1.5, 60.0, True),
    Parameter("Q", "MPa", 0.0, 10.0, 0.0, 2000.0),
    Parameter("b", "", 30.0, 0.47, 1.0, 3000.0, True),
    Parameter("tau0_112", "", 1.0, 0.10, 0.3, 3.0, True),
    Parameter("tau0_grain2", "", 1.0, 0.10, 0.3, 3.0, True),
    Parameter("elastic_scale", "", 1.0, 0.05, 0.3, 3.0, True),
    Parameter("C44_scale", "", 1.0, 0.10, 0.5, 2.0, True),
)
"""The parameters of the law that can be identified or tried as a cause, with prior scales."""

"""What CalculiX and its law SINGLE_CRYSTAL have, and values that they refuse."""

from __future__ import annotations

import numpy as np

from solver_adapters.constants import isotropic_hardening
from solver_adapters.crystal import BCC, FCC, N_110
from solver_adapters.interface import Capabilities, Simulation, UnsupportedError
from solver_adapters.material import Material
from solver_adapters.profile import Profile
from solver_adapters.registry import installed_capabilities

CAPABILITIES = Capabilities(
    material=frozenset(
        ("C11", "C12", "C44", "K", "n", "tau0", "c", "d", "tau0_grain2", "elastic_scale")
        + ("C44_scale",)
    ),
    strain_measures=frozenset(("small",)),
    derivatives=False,
    # Seven digits are in the .dat, but runs of nearly the same simulation jump by as much as this
    # at `least_steps`, where a point drops another slip system (docs/calculix.md).
    noise=1e-5,
    cost=50.0,
    conditional=frozenset(
        ("tau0_112", "slip_systems", "Q", "b", "h_latent", "Q_latent", "interaction")
    ),
    cells=frozenset((10, 20)),
    tet10_points=frozenset((4,)),
    least_steps=20,
)
"""Q is conditional, as it comes with a latent hardening that is fixed in CalculiX."""

LATENT = -0.1
"""Interaction of any two octahedral systems in CalculiX's umat_single_crystal.f."""

# {112} systems never slip where their tau0 is this many times that of {110}: 40 GPa and more.
_OFF = 1000.0
_ROUNDING = 1e-12


def check_supported(simulation: Simulation, profile: Profile) -> None:
    """Raise where a value of what CalculiX has is one that it cannot do.

    Raises:
        UnsupportedError: one sentence: parameter or option, its value, what is expected, and the
            installed solvers that can.
    """
    if profile.processes > 1:
        raise UnsupportedError(
            f"processes = {profile.processes} in the profile of calculix: CalculiX runs in one "
            "process; expected processes = 1, and threads for more cores"
        )
    material = simulation.material
    if material.slip_systems not in (BCC, FCC):
        _refuse(
            "slip_systems other than those of BCC or FCC: CalculiX has the octahedral ones; "
            "expected those of FCC, or of BCC without {112}",
            "slip_systems",
        )
    if material.slip_systems == BCC and material.tau0_112 < _OFF:
        _refuse(
            f"tau0_112 = {material.tau0_112:g}: CalculiX has no {{112}}⟨111⟩ systems; expected "
            f"{_OFF:g} or more, which switches them off",
            "tau0_112",
        )
    if hardens(material):
        _refuse_interaction(material)


def hardens(material: Material) -> bool:
    """Whether the isotropic hardening is not at its null."""
    return (material.Q > 0 or material.Q_latent > 0) and material.b > 0


def _refuse_interaction(material: Material) -> None:
    apart = ~np.eye(N_110, dtype=np.bool_)
    block = isotropic_hardening(material)[1][:N_110, :N_110]
    if abs(block - np.where(apart, LATENT, 1.0)).max() > _ROUNDING:
        own = f" and Q_latent = {material.Q_latent:g}" if material.Q_latent else ""
        own += "" if material.interaction is None else " and an interaction of its own"
        _refuse(
            f"Q = {material.Q:g} with h_latent = {material.h_latent:g}{own}: CalculiX fixes the "
            f"interaction of its systems at 1 and {LATENT:g}; expected Q = "
            f"Q_latent = 0, or h_latent = {LATENT:g} without Q_latent and interaction",
            "h_latent",
        )


def _refuse(found: str, parameter: str) -> None:
    able = (n for n, theirs in installed_capabilities().items() if parameter in theirs.material)
    raise UnsupportedError(f"{found}, or one of the solvers that can: {', '.join(able)}")

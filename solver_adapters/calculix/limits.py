"""What CalculiX's law SINGLE_CRYSTAL cannot do, refused by name before a deck is written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields

import numpy as np

from solver_adapters.crystal import N_110, N_SYSTEMS
from solver_adapters.interface import Capabilities, Simulation, UnsupportedError
from solver_adapters.material import Material
from solver_adapters.registry import adapter_names, find_adapter

CAPABILITIES = Capabilities(
    material=frozenset(
        ("C11", "C12", "C44", "K", "n", "tau0", "c", "d", "tau0_grain2", "elastic_scale")
        + ("C44_scale",)
    ),
    strain_measures=frozenset(("small",)),
    derivatives=False,
    conditional=frozenset(("tau0_112", "Q", "b", "h_latent", "interaction")),
)
"""Q is conditional, as it comes with a latent hardening that is fixed in CalculiX."""

LATENT = -0.1
"""Interaction of any two octahedral systems in CalculiX's umat_single_crystal.f."""

# {112} systems never slip where their tau0 is this many times that of {110}: 40 GPa and more.
_OFF = 1000.0
# Parameters that act only where another one has left its null.
_RULED = ("b", "d2", "skin_thickness", "strain_measure")
_LIKE_TAU0_GRAIN2 = ("tau0_grains",)

Able = Callable[[Capabilities], bool]


def refuse_unsupported(simulation: Simulation) -> None:
    """Raise where a simulation asks for what CalculiX cannot do.

    Raises:
        UnsupportedError: one sentence: parameter or option, its value, what is expected, and the
            installed solvers that can.
    """
    _refuse_material(simulation.material)
    scheme = simulation.integration
    if scheme not in CAPABILITIES.integrations:
        _refuse(
            f'integration is "{scheme}"; CalculiX follows the law by backward Euler: expected '
            '"backward_euler"',
            lambda able: scheme in able.integrations,
        )
    if simulation.directions:
        _refuse(
            f"derivatives along {simulation.directions[0].name} are wanted; CalculiX has none",
            lambda able: able.derivatives,
        )
    if simulation.cell_fields:
        _refuse(
            "fields of the cells are wanted; CalculiX's are not read",
            lambda able: able.cell_fields,
        )
    if simulation.lattice_gradient is not None and simulation.lattice_gradient.any():
        _refuse(
            "lattice_gradient is not zero; CalculiX has one orientation for each grain",
            lambda able: able.derivatives,
        )
    if simulation.accuracy is not None:
        _refuse(
            f"accuracy is {simulation.accuracy:g} µN; CalculiX does not estimate the error of its "
            "steps: expected None",
            lambda able: able.derivatives,
        )


def _refuse_material(material: Material) -> None:
    if material.strain_measure != "small":
        _refuse(
            f'strain_measure is "{material.strain_measure}"; CalculiX has its crystals in small '
            'strain only: expected "small"',
            lambda able: material.strain_measure in able.strain_measures,
        )
    null = Material()
    honoured = {*CAPABILITIES.material, *CAPABILITIES.conditional, *_RULED, *_LIKE_TAU0_GRAIN2}
    for name in (field.name for field in fields(Material)):
        if name not in honoured and getattr(material, name) != getattr(null, name):
            _refuse(
                f"{name} is {getattr(material, name):g}; CalculiX's law has no such term: expected "
                f"{getattr(null, name):g}",
                _having(name),
            )
    if material.tau0_112 < _OFF:
        _refuse(
            f"tau0_112 is {material.tau0_112:g}; CalculiX has no {{112}}⟨111⟩ systems: expected "
            f"{_OFF:g} or more, which switches them off",
            _having("tau0_112"),
        )
    if hardens(material):
        _refuse_interaction(material)


def hardens(material: Material) -> bool:
    """Whether the isotropic hardening is not at its null."""
    return material.Q > 0 and material.b > 0


def _refuse_interaction(material: Material) -> None:
    given = np.eye(N_SYSTEMS) if material.interaction is None else np.array(material.interaction)
    apart = ~np.eye(N_110, dtype=np.bool_)
    block = given[:N_110, :N_110] + material.h_latent * apart
    wanted = np.where(apart, LATENT, 1.0)
    if abs(block - wanted).max() > 1e-12:
        name = "h_latent" if material.interaction is None else "interaction"
        _refuse(
            f"Q is {material.Q:g} with h_latent = {material.h_latent:g}"
            f"{' and an interaction of its own' if name == 'interaction' else ''}; CalculiX "
            f"fixes the interaction of the {{110}}⟨111⟩ systems at 1 and {LATENT:g}: expected "
            f"Q = 0, or h_latent = {LATENT:g} without interaction",
            _having("h_latent"),
        )


def _having(name: str) -> Able:
    return lambda able: name in able.material


def _refuse(found: str, can: Able) -> None:
    others = [name for name in adapter_names() if can(find_adapter(name).capabilities())]
    raise UnsupportedError(f"{found}, or a solver that can: {', '.join(others) or 'none'}")

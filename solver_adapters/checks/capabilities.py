"""What a solver cannot honour, refused before it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields, replace

from solver_adapters.grain_scalars import as_honoured, later_names
from solver_adapters.interface import Capabilities, Simulation, UnsupportedError
from solver_adapters.material import TAU0_BANDS, Material, scalar

BASE = frozenset(
    (
        "C11", "C12", "C44", "K", "n", "tau0", "c", "d", "b", "d2", "skin_thickness",
        *(name for _, middle, half_width in TAU0_BANDS for name in (middle, half_width)),
        "strain_measure",
    )
)  # fmt: skip
"""What no solver is asked for as a term: the plain law, and companions that do nothing alone.

`b` acts with Q, `d2` with c2, `skin_thickness` with skin_tau0, middle and half width of a band with
its height; strain measures are capabilities of their own.
"""

_OF_LATER_GRAINS = frozenset(("tau0_grains", "tau0_grains_inside"))
# Terms of the law that are switched on by a value other than the default, their null.
_TERMS = tuple(
    field.name for field in fields(Material) if field.name not in BASE | _OF_LATER_GRAINS
)
# Who honours the scalar honours what is like it and not a scalar.
_LIKE = {"interaction": "h_latent"}


@dataclass(frozen=True)
class _Wish:
    """What a simulation asks for beyond the plain law.

    Attributes:
        what: its name, with the value.
        instead: what a solver would take that cannot honour it.
        honours: whether a solver can.
    """

    what: str
    instead: str
    honours: Callable[[Capabilities], bool]


def refuse_unsupported(
    simulation: Simulation,
    adapter: str,
    capabilities: Capabilities,
    others: Callable[[], Mapping[str, Capabilities]],
) -> None:
    """Raise where a simulation asks for what a solver cannot honour.

    Args:
        simulation: what is to be solved.
        adapter: name of the solver adapter.
        capabilities: what it can honour.
        others: what each installed solver can honour, by name; called for the sentence only.

    Raises:
        UnsupportedError: naming the parameter and the solvers that can.
    """
    # The adapter itself judges the values of the conditional ones.
    here = replace(capabilities, material=capabilities.material | capabilities.conditional)
    for wish in _wishes(simulation):
        if not wish.honours(here):
            able = ", ".join(name for name, theirs in others().items() if wish.honours(theirs))
            raise UnsupportedError(
                f"{wish.what}: the solver {adapter} cannot honour it; expected {wish.instead}, or "
                f"one of the solvers that can: {able or 'none is installed'}"
            )


def _wishes(simulation: Simulation) -> Iterator[_Wish]:
    material, null = simulation.material, Material()
    for name in _TERMS:
        if getattr(material, name) != getattr(null, name):
            shown = _shown(getattr(material, name))
            instead = "those of BCC" if name == "slip_systems" else "its null value"
            yield _Wish(f"{name} = {shown}", instead, _material(name))
    grains = 2 + max(len(material.tau0_grains), len(material.tau0_grains_inside))
    for name in later_names(grains):
        like, value = as_honoured(name), scalar(material, name)
        if like not in BASE and value != getattr(null, like):
            yield _Wish(f"{name} = {value:g}", "its null value", _material(like))
    measure, scheme = material.strain_measure, simulation.integration
    yield _Wish(
        f'strain_measure = "{measure}"', "another one", lambda c: measure in c.strain_measures
    )
    yield _Wish(f'integration = "{scheme}"', "another one", lambda c: scheme in c.integrations)
    nodes = simulation.mesh.cells.shape[1]
    yield _Wish(f"cells of {nodes} nodes", "cells of another kind", lambda c: nodes in c.cells)
    points = simulation.tet10_points
    if points is not None:
        yield _Wish(
            f"{points} Gauss points of a tetrahedron (gauss_points)",
            "those that it has by itself",
            lambda c: points in c.tet10_points,
        )
    if simulation.mean_dilatation:
        yield _Wish("mean_dilatation", "False", lambda c: c.mean_dilatation)
    if simulation.accuracy is not None:
        yield _Wish(f"accuracy = {simulation.accuracy:g} µN", "None", lambda c: c.accuracy)
    if simulation.lattice_gradient is not None:
        yield _Wish("lattice_gradient", "None", lambda c: c.lattice_gradient)
    if simulation.cell_fields:
        yield _Wish("fields of the cells", "none of them", lambda c: c.cell_fields)
    if simulation.directions:
        named = ", ".join(direction.name for direction in simulation.directions)
        yield _Wish(f"derivatives along {named}", "no directions", lambda c: c.derivatives)
    for direction in simulation.directions:
        if direction.times is not None:
            what = f"the derivative along {direction.name}, which moves the instants"
            yield _Wish(what, "directions without times", lambda c: c.times)


def _material(name: str) -> Callable[[Capabilities], bool]:
    return lambda c: name in c.material or _LIKE.get(name) in c.material


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else "given"

"""What a solver cannot honour, refused before it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from solver_adapters.interface import Capabilities, Simulation, UnsupportedError
from solver_adapters.material import Material

# Terms of the law that are switched on by a value other than the default, their null.
_TERMS = (
    "Q", "tau0_112", "tau0_grain2", "tau0_grains", "tau0_antitwinning", "a1", "h_latent",
    "interaction", "c2", "x0", "eigenstrain", "skin_tau0", "elastic_scale", "C44_scale",
)  # fmt: skip
# Who honours the scalar honours what is like it and not a scalar.
_LIKE = {"tau0_grains": "tau0_grain2", "interaction": "h_latent"}


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
    for what, honours in _wishes(simulation):
        if not honours(capabilities):
            able = ", ".join(name for name, theirs in others().items() if honours(theirs))
            raise UnsupportedError(
                f"{what}: the solver {adapter} cannot honour it; expected its null value, or one "
                f"of the solvers that can: {able or 'none is installed'}"
            )


def _wishes(simulation: Simulation) -> Iterator[tuple[str, Callable[[Capabilities], bool]]]:
    """What a simulation asks for beyond the plain law, with how to see who honours it."""
    material, null = simulation.material, Material()
    for name in _TERMS:
        if getattr(material, name) != getattr(null, name):
            yield f"{name} = {_shown(getattr(material, name))}", _material(name)
    measure = material.strain_measure
    yield f'strain_measure = "{measure}"', lambda c: measure in c.strain_measures
    if simulation.lattice_gradient is not None:
        yield "lattice_gradient", _material("lattice_gradient")
    if simulation.cell_fields:
        yield "fields of the cells", lambda c: c.cell_fields
    if simulation.directions:
        named = ", ".join(direction.name for direction in simulation.directions)
        yield f"derivatives along {named}", lambda c: c.derivatives


def _material(name: str) -> Callable[[Capabilities], bool]:
    return lambda c: name in c.material or _LIKE.get(name) in c.material


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else "given"

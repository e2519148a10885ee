"""Solvers by name: every installed entry point of the group `prismid.solvers`."""

from __future__ import annotations

from importlib.metadata import entry_points

from solver_adapters.interface import Adapter, Capabilities, UnsupportedError

GROUP = "prismid.solvers"


def adapter_names() -> tuple[str, ...]:
    """Names of the installed solvers."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def find_adapter(name: str) -> Adapter:
    """The solver of a name.

    Raises:
        UnsupportedError: no installed package registers it.
    """
    for point in entry_points(group=GROUP):
        if point.name == name:
            adapter: Adapter = point.load()()
            return adapter
    known = ", ".join(adapter_names()) or "none: is prismid installed?"
    raise UnsupportedError(f'solver.name: found "{name}", expected one of {known}')


def installed_capabilities() -> dict[str, Capabilities]:
    """What each installed solver can honour, by name."""
    return {name: find_adapter(name).capabilities() for name in adapter_names()}

"""Solvers by name: every installed entry point of the group `prismid.solvers`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib.metadata import entry_points

from solver_adapters.interface import Adapter, Capabilities, UnsupportedError
from solver_adapters.profile import Profile

GROUP = "prismid.solvers"


def adapter_names() -> tuple[str, ...]:
    """Names of the installed solvers."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def find_adapter(name: str, profile: Profile | None = None) -> Adapter:
    """The solver of a name.

    Args:
        name: word of the case file.
        profile: how its program is called; a solver without a program of its own takes none.

    Raises:
        UnsupportedError: no installed package registers it.
    """
    for point in entry_points(group=GROUP):
        if point.name == name:
            make: Callable[..., Adapter] = point.load()
            return make(profile) if takes_profile(make) else make()
    known = ", ".join(adapter_names()) or "none: is prismid installed?"
    raise UnsupportedError(f'solver.name: found "{name}", expected one of {known}')


def takes_profile(make: Callable[..., Adapter]) -> bool:
    """Whether a solver is a program of its own, whose adapter is made with a `Profile`."""
    return "profile" in inspect.signature(make).parameters


def installed_capabilities() -> dict[str, Capabilities]:
    """What each installed solver can honour, by name."""
    return {name: find_adapter(name).capabilities() for name in adapter_names()}

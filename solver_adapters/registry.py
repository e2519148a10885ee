"""Solvers by name: every installed entry point of the group `prismid.solvers`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import EntryPoint, entry_points

from solver_adapters.interface import (
    Adapter,
    Capabilities,
    Integration,
    SolverError,
    UnsupportedError,
)
from solver_adapters.profile import Profile

GROUP = "prismid.solvers"


def adapter_names() -> tuple[str, ...]:
    """Names of the installed solvers."""
    return tuple(sorted({point.name for point in entry_points(group=GROUP)}))


def find_adapter(name: str, profile: Profile | None = None) -> Adapter:
    """Return the solver of a name.

    Args:
        name: word of the case file.
        profile: how its program is called; a solver without a program of its own takes none.

    Raises:
        UnsupportedError: no installed package registers it, or its package cannot be used.
    """
    for point in entry_points(group=GROUP):
        if point.name == name:
            return _made(point, profile)
    known = ", ".join(adapter_names()) or "none: is prismid installed?"
    raise UnsupportedError(f'solver.name: found "{name}", expected one of {known}')


def find_in_process(integration: Integration) -> Adapter:
    """Return the first solver that simulates inside prismid, and by a scheme.

    Args:
        integration: the scheme.

    Raises:
        UnsupportedError: none is installed.
    """
    for name, solver in installed_capabilities().items():
        if solver.in_process and integration in solver.integrations:
            return find_adapter(name)
    known = ", ".join(adapter_names()) or "none"
    raise UnsupportedError(
        f"{GROUP}: found {known}, expected a solver that simulates inside prismid by {integration}"
    )


def _made(point: EntryPoint, profile: Profile | None) -> Adapter:
    try:
        make: Callable[..., Adapter] = point.load()
        adapter = make(profile) if takes_profile(make) else make()
        adapter.capabilities()  # in the words of another version of the interface it fails
        return adapter
    except SolverError:
        raise
    except Exception as fault:
        # Whatever it is, it is a fault of a package that others have written.
        raise UnsupportedError(
            f"the solver {point.name}: found no usable {point.value} "
            f"({type(fault).__name__}: {fault}), expected a class of the interface of this prismid"
        ) from fault


def takes_profile(make: Callable[..., Adapter]) -> bool:
    """Whether a solver is a program of its own, whose adapter is made with a `Profile`."""
    return "profile" in inspect.signature(make).parameters


def installed_capabilities() -> dict[str, Capabilities]:
    """Return what each installed solver that can be used can honour, by name."""
    usable = {}
    for name in adapter_names():
        with suppress(SolverError):
            usable[name] = find_adapter(name).capabilities()
    return usable

"""The extended model as decks for solvers that are programs of their own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from driver.case.model import Case
from driver.case.solver_profiles import profile_of
from driver.forward.model import ForwardModel
from driver.results.files import DECKS
from solver_adapters.external import ExternalAdapter
from solver_adapters.interface import Capabilities, Simulation, SolverError
from solver_adapters.registry import adapter_names, find_adapter


def write_decks(
    folder: Path, case: Case, model: ForwardModel, values: Mapping[str, float]
) -> dict[str, str | None]:
    """Write the decks of one simulation for every installed solver that can honour it.

    A deck is run in its folder as the solver is run by hand; no program has to be there for it.

    Args:
        folder: where the folder of the decks is made, one folder a solver in it.
        case: the case, for the profiles of the solvers.
        model: the extended model.
        values: of all its parameters.

    Returns:
        By the name of the solver: None where the deck was written, else why it was not.
    """
    refusals: dict[str, str | None] = {}
    for name, files in rendered_decks(case, model, values).items():
        refusals[name] = files if isinstance(files, str) else None
        for file, content in {} if isinstance(files, str) else files.items():
            path = folder / DECKS / name / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    return refusals


def rendered_decks(
    case: Case, model: ForwardModel, values: Mapping[str, float]
) -> dict[str, Mapping[str, bytes] | str]:
    """Return the decks of one simulation for every installed solver that is a program of its own.

    Args:
        case: the case, for the profiles of the solvers.
        model: the model.
        values: of all its parameters.

    Returns:
        By the name of the solver: the files of the deck, or why it cannot honour the simulation.
    """
    decks: dict[str, Mapping[str, bytes] | str] = {}
    for name in adapter_names():
        own = case.model_copy(update={"solver": case.solver.model_copy(update={"name": name})})
        try:
            adapter = find_adapter(name, profile_of(own))
        except SolverError as unusable:
            decks[name] = str(unusable)
            continue
        if not isinstance(adapter, ExternalAdapter):
            continue
        asked = _as_offered(model.simulation(values), adapter.capabilities())
        try:
            decks[name] = adapter.files(asked)
        except SolverError as refused:
            decks[name] = str(refused)
    return decks


def _as_offered(simulation: Simulation, solver: Capabilities) -> Simulation:
    """Return the same physics in the scheme, steps and quadrature that a solver has."""
    offered = simulation.integration in solver.integrations
    return replace(
        simulation,
        integration=simulation.integration if offered else "backward_euler",
        accuracy=simulation.accuracy if solver.accuracy else None,
        tet10_points=None,
        mean_dilatation=simulation.mean_dilatation and solver.mean_dilatation,
    )

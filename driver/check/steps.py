"""How many time steps an interval a scheme of first order needs, estimated before a run.

The specimen is simulated on a few cells, from the starting values of the law and with an
elongation in proportion to the stage travel. Its loads in the stated steps, in halves and in
quarters of them tell the error of the steps: it falls with their length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from driver.case.model import Case
from driver.common.errors import InputError
from driver.doubts.finding import Finding
from driver.experiment.history import History
from driver.forward.boundary_motion import knots_of_stage
from driver.forward.build import build_model, integration_of, mesh_of
from driver.identification.step_error import FIRST_ORDER
from driver.parameters.boundary import elongation_names
from solver_adapters.interface import Adapter, SolverError
from solver_adapters.registry import find_in_process

_CELL = 0.5  # length of the cells over that of the specimen
_SHARE = 0.5  # of the noise of the loads that the error of the steps may reach, rms
_SERVED = 1 / 4  # of a step, by which the recommendation is rounded down
_MOST_TRIED, _MOST_TOLD = 4, 1000  # steps an interval


def recommended_steps(case: Case, adapter: Adapter, history: History) -> Iterator[Finding]:
    """Yield the steps an interval that the solver of a case needs, where they err to first order.

    Args:
        case: the case.
        adapter: its solver.
        history: its history.
    """
    if (
        integration_of(case, adapter.capabilities()) != FIRST_ORDER
        or case.solver.accuracy_uN is not None
    ):
        return
    stated, noise = case.solver.steps_per_interval, case.loads.noise_uN
    try:
        error = load_error_of_steps(case, history, stated)
    except (InputError, SolverError) as reason:
        yield Finding("warning", "steps", f"the error of the time steps is not known: {reason}")
        return
    least = adapter.capabilities().least_steps
    wanted = max(min(stated * error / (_SHARE * noise) - _SERVED, _MOST_TOLD), least, 1)
    estimate = (
        f"solver.steps_per_interval: found {stated}, with which backward Euler leaves about "
        f"{error:.2g} µN rms of the loads wrong (their noise is {noise:g} µN)"
    )
    if stated >= wanted or error <= _SHARE * noise and stated >= least:
        yield Finding("ok", "steps", estimate)
        return
    why = f", and {case.solver.name} needs at least {least}" if stated < least else ""
    yield Finding(
        "warning",
        "steps",
        f"{estimate}{why}; expected about {math.ceil(wanted)}. What is left is estimated in the "
        "run and counted by the uncertainties",
    )


def load_error_of_steps(case: Case, history: History, steps: int) -> float:
    """Error of the loads that steps of first order make, rms [µN], to a factor of two or so.

    Many steps are not tried: the error falls with their length.

    Args:
        case: the case.
        history: its history.
        steps: steps an interval.

    Raises:
        InputError: the case describes no prism.
        SolverError: the specimen cannot be simulated.
    """
    solver = find_in_process(FIRST_ORDER)
    first_order = case.model_copy(
        update={"solver": case.solver.model_copy(update={"integration": FIRST_ORDER})}
    )
    mesh = mesh_of(case, max(case.specimen.mesh_size, _CELL * case.specimen.length))
    no_pixels = np.zeros((0, 2))
    tried = min(steps, _MOST_TRIED)
    halves, quarters = (
        build_model(first_order, mesh, history, no_pixels, solver, n * tried) for n in (2, 4)
    )
    ratio = case.boundary.stage_ratio or case.specimen.length / case.history.grip_distance
    travel = history.stage[history.turning]
    names = elongation_names(len(travel))
    along, _ = knots_of_stage(travel, ratio, 0.0)
    values = halves.null_values() | dict(zip(names, along.tolist(), strict=True))
    # Of the finest pair, which is nearest to first order: quarters err by as much as they change.
    change = quarters.predict(values).load - halves.predict(values).load
    return 4.0 * float(np.sqrt(np.mean(change**2))) * tried / steps

"""Where the time steps of a simulation end, and the motion there: the same for every solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.interface import Response, Simulation

SAME_INSTANT = 1e-9
"""Instants that differ by less than this share of the whole time are the same."""


def step_ends(simulation: Simulation, parts: int = 1) -> FloatArray:
    """Return the instants, and between them the ends of the time steps that are asked for.

    A given step that ends at an instant but for rounding ends at the instant itself.

    Args:
        simulation: what is solved.
        parts: equal steps between two instants where `Simulation.steps` gives none.

    Returns:
        ends [s], increasing, the first instant before them, shape (n_steps + 1,).
    """
    times, steps = simulation.times, simulation.steps
    if steps is None:
        pairs = zip(times[:-1], times[1:], strict=True)
        inner = [np.linspace(begin, end, parts + 1)[1:] for begin, end in pairs]
        return np.concatenate([times[:1], *inner])
    gap = abs(steps[:, None] - times).min(axis=1)
    between = steps[gap > SAME_INSTANT * (times[-1] - times[0])]
    return np.sort(np.concatenate([times, between]))


def once_more(simulation: Simulation, response: Response) -> Simulation:
    """Return the simulation as it is to be run again, for other directions or beside it.

    It begins its iterations by the trajectory of its response, and takes the steps that this one
    chose for itself: other steps have other errors, which would be taken for an effect of a
    parameter.
    """
    if response.trajectory is not None:
        simulation = replace(simulation, warm_start=response.trajectory)
    if response.ends.size and (response.cuts or simulation.accuracy is not None):
        simulation = replace(simulation, steps=response.ends, accuracy=None)
    return simulation


def between_instants(instant: float, times: FloatArray, values: FloatArray) -> FloatArray:
    """Return what is known at instants, in between: linear in time.

    Args:
        instant: when it is wanted [s].
        times: the instants [s], shape (n_times,).
        values: what is known at them, shape (n_times, ...).
    """
    index = int(np.clip(np.searchsorted(times, instant), 1, len(times) - 1))
    weight = (instant - times[index - 1]) / (times[index] - times[index - 1])
    return np.asarray((1 - weight) * values[index - 1] + weight * values[index])

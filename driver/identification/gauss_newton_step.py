"""One step of the fit: Gauss–Newton, damped into the trusted range and held at the bounds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

LARGEST_STEP_LOG = 0.6
LARGEST_STEP = 8.0  # prior scales


def bounded_step(
    hessian: FloatArray,
    gradient: FloatArray,
    parameters: Sequence[Parameter],
    values: Sequence[float],
) -> tuple[FloatArray, float]:
    """Gauss–Newton step, damped until no parameter leaves its trusted range.

    Damping in units of the range shortens the weak directions, along which a linearised model
    runs far, and leaves the strong ones alone. A parameter at its bound that the step would
    push further is held there.

    Args:
        hessian: of the cost, halved, in θ, shape (k, k).
        gradient: downhill, shape (k,).
        parameters: the free parameters.
        values: where they stand.

    Returns:
        step in θ, shape (k,), and the Newton decrement: that of the step without damping, for
        a short step is no sign of being near.
    """
    limits = np.array([LARGEST_STEP_LOG if p.logarithmic else LARGEST_STEP for p in parameters])
    held = np.zeros(limits.size, dtype=bool)
    hessian, gradient = hessian * np.outer(limits, limits), gradient * limits
    least = damping = 1e-12 * float(np.max(np.diag(hessian), initial=1.0))
    decrement = 0.0
    while True:
        step = np.zeros(limits.size)
        active = np.flatnonzero(~held)
        damped = hessian[np.ix_(active, active)] + damping * np.eye(active.size)
        step[active] = np.linalg.solve(damped, gradient[active])
        if damping == least:
            decrement = math.sqrt(max(float(step @ gradient), 0.0))
        outward = np.array(
            [
                not low and _leads_outside(parameter, value, change)
                for parameter, value, change, low in zip(
                    parameters, values, step, held, strict=True
                )
            ],
            dtype=bool,
        )
        if outward.any():
            held |= outward
            damping = least
        elif np.max(np.abs(step), initial=0.0) <= 1.0:
            return np.asarray(limits * step), decrement
        else:
            damping = max(10.0 * damping, 1e-2)


def trial_values(
    values: Mapping[str, float],
    free: Sequence[str],
    step: FloatArray,
    parameters: Mapping[str, Parameter],
) -> dict[str, float]:
    """Every parameter after a step in θ of the free ones, kept inside the bounds."""
    moved = {
        name: parameters[name].value(float(change), values[name])
        for name, change in zip(free, step, strict=True)
    }
    return dict(values) | moved


def is_at_bound(parameter: Parameter, value: float) -> bool:
    """Whether a value stands at a bound of its parameter."""
    return value <= parameter.lower or value >= parameter.upper


def _leads_outside(parameter: Parameter, value: float, change: float) -> bool:
    return (value <= parameter.lower and change < 0) or (value >= parameter.upper and change > 0)

"""A box whose crystal law fails or misleads where a test says so."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import Problem, build_problem
from solver_adapters.bundled.law.gauss_points import Points, PointSolution
from solver_adapters.interface import Simulation


@dataclass(frozen=True, eq=False)
class TroubledLaw(Points):
    """The crystal law, except that a point fails in long steps and that the tangent is wrong.

    Attributes:
        longest: no point fails in a step up to this length [s].
        failing: the point that fails in longer ones.
        tangent: factor on the tangent.
        calls: lengths of the steps it was asked for [s].
    """

    longest: float = np.inf
    failing: int = 0
    tangent: float = 1.0
    calls: list[float] = field(default_factory=list)

    def update(
        self, H: FloatArray, state0: FloatArray, guess: FloatArray, dt: float, *more: Any
    ) -> PointSolution:
        self.calls.append(dt)
        solution = super().update(H, state0, guess, dt, *more)
        if dt > self.longest:
            solution.iterations[self.failing] = -1
        return replace(solution, C=self.tangent * solution.C)


def troubled_problem(simulation: Simulation, **law: Any) -> Problem:
    """The problem of a simulation, its law with the fields of `TroubledLaw`."""
    problem = build_problem(simulation)
    parts = {item.name: getattr(problem.points, item.name) for item in fields(Points)}
    return replace(problem, points=TroubledLaw(**parts, **law))


def calls(problem: Problem) -> list[float]:
    """Lengths of the steps that the law of such a problem was asked for [s]."""
    law = problem.points
    assert isinstance(law, TroubledLaw)
    return law.calls

"""Objectives and evaluations given by formulas, for tests of what only looks at residuals."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from driver.identification.objective import Evaluation, Objective
from driver.identification.paper_chi import PaperChi
from meshes.arrays import FloatArray
from solver_adapters.interface import Response
from solver_adapters.parameter import Parameter

Curve = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class _Nothing:
    """A prediction of which nobody asks more than to be restricted, and for notes."""

    response: Response = Response(
        np.zeros((0, 0, 3)), np.zeros(0), np.zeros((0, 0, 0, 3)), np.zeros((0, 0))
    )

    def restrict(self, rows: Sequence[int]) -> _Nothing:
        return self


_NOTHING = cast(Any, _Nothing())


def evaluation(
    residual: FloatArray,
    jacobian: FloatArray,
    prior_weight: FloatArray | None = None,
    prior_gap: FloatArray | None = None,
    n_load: int = 0,
    free: Sequence[str] = (),
    values: Mapping[str, float] | None = None,
) -> Evaluation:
    """An evaluation of which only residual (n,), Jacobian (k, n) and prior matter."""
    k = len(jacobian)
    return Evaluation(
        values=dict(values or {}),
        free=tuple(free) or tuple(f"p{i}" for i in range(k)),
        residual=residual,
        jacobian=jacobian,
        prior_gap=np.zeros(k) if prior_gap is None else prior_gap,
        prior_weight=np.zeros(k) if prior_weight is None else prior_weight,
        n_load=n_load,
        load=np.zeros(0),
        motion=np.zeros((0, 0, 3)),
        rho=np.zeros((0, 0)),
        shift=np.zeros((0, 0)),
        prediction=_NOTHING,
        paper=PaperChi(0.0, 0.0, 0.0),
    )


@dataclass(frozen=True, eq=False)
class Formula(Objective):
    """Measured minus `curve(p)`, p in the order of the parameters.

    Attributes:
        measured: whitened measurements, shape (n,).
        curve: values (n,) and derivatives with respect to the values of p (k, n).
        tried: every point that was evaluated.
    """

    measured: FloatArray = field(kw_only=True)
    curve: Curve = field(kw_only=True)
    tried: list[dict[str, float]] = field(default_factory=list)

    def with_time_steps_of(self, here: Evaluation) -> Formula:
        """A formula takes no time steps."""
        return self

    def warm_started_from(self, here: Evaluation) -> Formula:
        """Nor has it iterations to begin."""
        return self

    def evaluate(self, values: Mapping[str, float], free: Sequence[str]) -> Evaluation:
        """Residual and Jacobian with respect to θ of the free parameters."""
        self.tried.append(dict(values))
        names = list(self.parameters)
        predicted, derivative = self.curve(np.array([values[name] for name in names]))
        rows = [names.index(name) for name in free]
        slopes = np.array([self.parameters[name].slope(values[name]) for name in free])
        gap, weight = self._prior_at(values, free)
        return evaluation(
            self.measured - predicted, derivative[rows] * slopes[:, None], weight, gap,
            free=free, values=values,
        )  # fmt: skip


def formula(
    curve: Curve,
    measured: FloatArray,
    parameters: Sequence[Parameter],
    prior: Mapping[str, tuple[float, float]] | None = None,
) -> Formula:
    """The objective of a formula."""
    model: Any = SimpleNamespace(null_values=lambda: {p.name: p.null for p in parameters})
    return Formula(
        model, _NOTHING, {p.name: p for p in parameters}, prior or {},
        measured=measured, curve=curve,
    )  # fmt: skip


def rosenbrock(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A bent valley with steep sides, its end at (1, 1) for data of (0, 1)."""
    return np.array([10 * (p[1] - p[0] ** 2), p[0]]), np.array([[-20 * p[0], 1.0], [10.0, 0.0]])


def bent(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same valley with lower sides."""
    predicted, slopes = rosenbrock(p)
    return np.array([0.2, 1.0]) * predicted, np.array([0.2, 1.0]) * slopes

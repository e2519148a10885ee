from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.search import refit
from driver.diagnosis.search.refit import (
    Executor,
    Start,
    as_wide_as_found,
    nominal_starts,
    refit_causes,
    refit_from,
    refit_from_afar,
    with_prior,
)
from driver.diagnosis.statistics.score_test import Score, score
from driver.identification.fit import fit
from driver.identification.objective import Objective
from meshes.arrays import FloatArray
from solver_adapters.interface import NotRunError, SolverError
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import Status
from solver_adapters.parameter import Parameter
from tests.driver.analytic import formula
from tools import closed_form

RNG = np.random.default_rng(9)
A = RNG.standard_normal((4, 50))
PARAMETERS = [
    Parameter("a", "", 0.0, 1.0), Parameter("b", "", 0.0, 0.5), Parameter("Q", "MPa", 0.0, 10.0),
    Parameter("load_drift", "µN", 0.0, 20.0),
]  # fmt: skip
ZERO = {p.name: 0.0 for p in PARAMETERS}


def test_priors_of_a_refit_stand_about_the_case_three_scales_of_the_library_wide() -> None:
    b = closed_form.problem()
    material = b.case.material.model_copy(update={"n": 20.0})
    model = closed_form.problem(b.case.model_copy(update={"material": material})).model
    objective = closed_form.objective(b, b.truth)
    rates = Cause("rates", "material", ("n", "K"), "", "", companions=("b",))
    prior = with_prior(type(objective)(model, objective.data, objective.parameters), rates).prior
    assert {name: mean for name, (mean, _) in prior.items()} == {"n": 20.0, "K": 12.0, "b": 30.0}
    widths = [prior[name][1] for name in ("n", "K", "b")]
    assert widths == pytest.approx([3 * 0.3, 3 * 0.3, 0.47])
    drift = with_prior(objective, Cause("drift", "instrument", ("load_drift",), "", ""))
    assert drift.prior == {"load_drift": (0.0, 3.0)} and objective.prior == {}


def test_a_large_effect_is_not_drawn_towards_its_null() -> None:
    """Ten prior scales, known to a third of one: the first prior takes a tenth of it away."""
    response = 0.3 * np.eye(1, 50)  # per MPa, a tenth of a prior scale
    measured = 100.0 * response[0]
    parameters = [Parameter("Q", "MPa", 0.0, 10.0)]
    objective = formula(lambda p: (p @ response, response), measured, parameters, {"Q": (0.0, 1.0)})
    cause = Cause("x", "material", ("Q",), "", "")

    def found(with_: Objective) -> float:
        return fit(with_, {"Q": 0.0}, ("Q",), 9, tolerance=1e-9).values["Q"]

    first = found(objective)
    assert first == pytest.approx(90.0)
    widened = as_wide_as_found(objective, cause, {"Q": first})
    assert found(widened) == pytest.approx(100.0, rel=2e-3)
    assert as_wide_as_found(objective, cause, {"Q": 5.0}).prior == objective.prior


def two_valleys() -> tuple[Objective, Score]:
    """x has a shallow valley near its null, and a deep one three scales off."""
    parameters = [Parameter("a", "", 0.0, 1.0), Parameter("x", "", 0.0, 0.1)]

    def curve(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = p[1] / 0.1
        far, near = np.exp(-((x - 3) ** 2) / 0.5), np.exp(-(x**2))
        height = 20 - 20 * far + 3 * (1 - near)
        slope = 80 * (x - 3) * far + 6 * x * near
        return np.array([p[0], height]), np.array([[1.0, 0.0], [0.0, slope / 0.1]])

    model = cast(Any, SimpleNamespace(null_values=lambda: {"a": 0.0, "x": 0.0}))
    objective = replace(formula(curve, np.zeros(2), parameters), model=model)
    cause = Cause("x", "material", ("x",), "", "")
    scored: Any = SimpleNamespace(cause=cause, estimate=np.array([-0.2]))
    return objective, cast(Score, scored)


def test_a_fit_that_stalls_by_its_null_is_found_from_afar() -> None:
    objective, scored = two_valleys()
    baseline = fit(objective, {"a": 0.0, "x": 0.0}, ("a",), 5).best
    screening = objective.evaluate(baseline.values, ("a", "x"))
    (near,) = refit_causes([scored], screening, baseline, objective, Executor(1, 1))
    far = refit_from_afar([scored], baseline, objective, Executor(1, 1), np.inf)
    best = min(far, key=lambda refit: refit.fit.best.cost)
    assert near.fit.best.cost > 300 and best.fit.best.cost < 25
    assert best.fit.values["x"] == pytest.approx(0.3, abs=0.02)


def test_a_start_whose_first_step_promises_too_little_is_given_up(
    lines: list[str],
) -> None:
    objective, scored = two_valleys()
    baseline = fit(objective, {"a": 0.0, "x": 0.0}, ("a",), 5).best
    lines.clear()
    assert refit_from_afar([scored], baseline, objective, Executor(1, 1), -1.0) == []
    assert len(lines) == 4 and all("promises too little" in line for line in lines)


def where_nothing_answers(error: Exception) -> list[Start]:
    """A start whose first simulation fails."""

    def never(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        raise error

    objective, scored = two_valleys()
    baseline = fit(objective, {"a": 0.0, "x": 0.0}, ("a",), 5).best
    beyond = formula(never, np.zeros(2), list(objective.parameters.values()))
    return [Start(scored.cause, beyond, {"a": 0.0, "x": 0.3}, None, baseline, np.inf, 5)]


@pytest.mark.parametrize("error", [NotRunError("absent"), JobError("bar", Status.KILLED)], ids=str)
def test_a_start_that_was_not_run_ends_the_refits(error: SolverError) -> None:
    """It was told as given up, and the answer was made without it."""
    with pytest.raises(type(error)):
        refit_from(where_nothing_answers(error), Executor(1, 1))


def test_a_start_that_cannot_be_simulated_is_given_up_and_told(
    lines: list[str],
) -> None:
    starts = where_nothing_answers(SolverError("no step is short enough\nat t = 1 s"))
    lines.clear()
    assert refit_from(starts, Executor(1, 1)) == []
    told = "a start is given up, for it cannot be simulated (no step is short enough)"
    assert lines == [f"  x: {told}"]


def test_causes_that_bend_are_refitted_first_and_answered_in_the_order_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """They take the most iterations: the last one kept a core busy, and the other waited."""
    (start,) = where_nothing_answers(SolverError("no step"))
    causes = [
        replace(start.cause, name=n, strongly_nonlinear=n == "bent") for n in ("flat", "bent")
    ]
    begun: list[str] = []

    def fitted(task: Start) -> Any:
        begun.append(task.cause.name)
        return task.cause

    monkeypatch.setattr(refit, "_fitted", fitted)
    monkeypatch.setattr(refit, "refit_of", lambda cause, objective, result, baseline: result)
    monkeypatch.setattr(refit, "refit_line", lambda result: result.name)
    starts = [replace(start, cause=cause) for cause in causes]
    answered: Any = refit_from(starts, Executor(1, 1))
    assert begun == ["bent", "flat"] and answered == causes


def test_a_companion_that_is_free_already_is_freed_once() -> None:
    """As b with Q_latent, where Q was added before."""
    measured = A.T @ [0.5, 0.1, 0.6, 0.0] + RNG.standard_normal(50)
    prior = {"b": (0.2, 0.4)}
    bare = formula(lambda p: (p @ A, A), measured, PARAMETERS, prior)
    baseline = fit(bare, ZERO, ("a", "b"), 3, tolerance=1e-9).best
    objective = replace(
        formula(lambda p: (p @ A, A), measured, PARAMETERS, prior),
        model=cast(Any, SimpleNamespace(null_values=lambda: ZERO | {"b": 0.2})),
    )
    screening = objective.evaluate(baseline.values, ("a", "b", "Q"))
    evidence = []
    for companions in ((), ("b",)):
        cause = Cause("x", "material", ("Q",), "", "", companions)
        scored = score(cause, screening.jacobian[2:], baseline, 1)
        (refit,) = refit_causes([scored], screening, baseline, objective, Executor(1, 1))
        assert refit.fit.best.free == ("a", "b", "Q")
        evidence.append(refit.log_evidence)
    assert evidence[0] == pytest.approx(evidence[1], abs=1e-9)


def test_prior_odds_count_in_the_evidence() -> None:
    objective, scored = two_valleys()
    baseline = fit(objective, {"a": 0.0, "x": 0.0}, ("a",), 5).best
    screening = objective.evaluate(baseline.values, ("a", "x"))
    unlikely: Any = SimpleNamespace(cause=replace(scored.cause, odds=0.01))
    (even,), (odd,) = (
        refit_causes([one], screening, baseline, objective, Executor(1, 1))
        for one in (scored, cast(Score, unlikely))
    )
    assert odd.log_evidence == pytest.approx(even.log_evidence - np.log(100))


def test_starts_are_nominal_with_the_cause_one_and_three_scales_off() -> None:
    objective, scored = two_valleys()
    extended = with_prior(replace(objective, prior={"a": (0.5, 1.0)}), scored.cause)
    baseline = fit(objective, {"a": 0.0, "x": 0.0}, ("a",), 5).best
    starts = nominal_starts(scored, baseline, extended)
    assert sorted(start["x"] for start in starts) == pytest.approx([-0.3, -0.1, 0.1, 0.3])
    assert {start["a"] for start in starts} == {0.5}
    rising: Any = SimpleNamespace(
        cause=replace(scored.cause, one_sided=True), estimate=scored.estimate
    )
    starts = nominal_starts(cast(Score, rising), baseline, extended)
    assert sorted(start["x"] for start in starts) == pytest.approx([0.1, 0.3])

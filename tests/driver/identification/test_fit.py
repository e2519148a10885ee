from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from driver.common.errors import InputError
from driver.identification.fit import DECREMENT, SCATTER, Fit, fit, to_its_end
from driver.identification.gauss_newton_step import LARGEST_STEP, LARGEST_STEP_LOG
from driver.identification.line_search import MOST_HALVINGS, promised
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray
from solver_adapters.interface import NotRunError, PreparedError, SolverError
from solver_adapters.jobs.errors import CommandMissingError, JobError
from solver_adapters.jobs.status import Status
from solver_adapters.parameter import Parameter
from solver_adapters.result_files import ResultFileError
from tests.driver.analytic import Curve, Formula, bent, formula, rosenbrock

RNG = np.random.default_rng(4)
A = RNG.standard_normal((3, 40))
PLAIN = [Parameter(name, "", 0.0, scale) for name, scale in (("a", 1.0), ("b", 0.5), ("c", 2.0))]
ZERO = dict.fromkeys("abc", 0.0)


def linear(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    return p @ A, A


def exponential(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    t = np.linspace(0, 1, 20)
    decay = np.exp(-p[1] * t)
    return 50 * p[0] * decay, 50 * np.stack([decay, -p[0] * t * decay])


def costs(found: Fit) -> list[float]:
    return [record["cost"] for record in found.history]


def test_each_trial_point_begins_by_the_simulation_of_the_point_before_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun: list[dict[str, float]] = []

    class Beside(Formula):
        """A formula beside a point, which is noted when it is evaluated."""

        def evaluate(self, values: Mapping[str, float], free: Sequence[str]) -> Evaluation:
            begun.append(vars(self)["beside"])
            return super().evaluate(values, free)

    def near(self: Formula, here: Evaluation) -> Formula:
        known = {name: value for name, value in vars(self).items() if name != "beside"}
        beside = Beside(**known)
        vars(beside)["beside"] = here.values
        return beside

    monkeypatch.setattr(Formula, "warm_started_from", near)
    plain = formula(exponential, exponential(np.array([1.2, 2.0]))[0], PLAIN[:2])
    found = fit(plain, {"a": 1.0, "b": 1.0}, "ab", 10)
    points = [{name: record[name] for name in "ab"} for record in found.history]
    assert found.converged and len(points) > 3
    assert begun == points[:-1]
    begun.clear()
    valley = formula(bent, np.array([0.0, 1.0]), PLAIN[:2])
    fit(valley, {"a": -1.2, "b": 1.0}, "ab", 9, tolerance=1e-6)
    assert begun == valley.tried[:3]  # the second of them lies above the first


def test_a_linear_gaussian_problem_is_solved_in_one_step_with_its_prior() -> None:
    prior = {"a": (0.3, 0.2), "c": (1.0, 0.4)}
    measured = np.array([0.5, -0.2, 0.8]) @ A + RNG.standard_normal(40)
    found = fit(formula(linear, measured, PLAIN, prior), ZERO, "abc", 5)
    # Bayes in the values: prior deviations are widths (in θ) times the scales.
    precision = np.diag([1 / 0.2**2, 0.0, 1 / (0.4 * 2.0) ** 2])
    covariance = np.linalg.inv(A @ A.T + precision)
    mean = covariance @ (A @ measured + precision @ [0.3, 0.0, 1.0])
    assert found.converged and len(found.history) == 2
    np.testing.assert_allclose([found.values[n] for n in "abc"], mean, rtol=1e-9)
    sigma = [found.sigma(n, {p.name: p for p in PLAIN}) for n in "abc"]
    np.testing.assert_allclose(sigma, np.sqrt(np.diag(covariance)), rtol=1e-9)


def test_parameters_that_are_not_free_stay() -> None:
    found = fit(formula(linear, np.ones(40), PLAIN), ZERO | {"b": 0.7}, ("a", "c"), 5)
    assert found.values["b"] == 0.7 and found.best.free == ("a", "c")


def test_a_logarithmic_parameter_is_found_from_far_away_and_stays_positive() -> None:
    parameters = [
        Parameter("amplitude", "", 1.0, 1.0, 1e-3, 1e3, True),
        Parameter("rate", "", 1.0, 1.0, 1e-3, 1e3, True),
    ]
    objective = formula(exponential, exponential(np.array([2.0, 3.0]))[0], parameters)
    found = fit(objective, {"amplitude": 0.2, "rate": 0.3}, ("amplitude", "rate"), 30)
    assert found.converged
    np.testing.assert_allclose([found.values["amplitude"], found.values["rate"]], [2, 3], rtol=1e-3)
    assert all(value > 0 for point in objective.tried for value in point.values())


@pytest.mark.parametrize("logarithmic", [True, False])
def test_no_step_leaves_the_trusted_range(logarithmic: bool) -> None:
    def steep(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return 1e3 * p, np.array([[1e3]])

    parameter = Parameter("p", "", 1.0, 0.01, -1e9, 1e9, logarithmic)
    objective = formula(steep, np.array([1e6]), [parameter])
    fit(objective, {"p": 1.0}, ("p",), 1)
    start, first = (point["p"] for point in objective.tried[:2])
    moved = parameter.theta(first, start)
    limit = LARGEST_STEP_LOG if logarithmic else LARGEST_STEP
    assert 0.5 * limit < moved <= limit * (1 + 1e-12)


def test_damping_shortens_the_weak_direction_and_spares_the_strong() -> None:
    # b is hardly seen: the linear solution lies 1000 scales away.
    def weak(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([100 * p[0], 0.01 * p[1]]), np.diag([100.0, 0.01])

    objective = formula(weak, np.array([100.0, 5.0]), PLAIN[:2])
    fit(objective, {"a": 0.0, "b": 0.0}, "ab", 1)
    first = objective.tried[1]
    assert first["a"] == pytest.approx(1.0, rel=1e-3) and 0 <= first["b"] <= LARGEST_STEP * 0.5


def test_a_parameter_is_held_at_its_bound_while_the_others_are_fitted() -> None:
    bounded = [Parameter("a", "", 0.0, 1.0, -1.0, 0.25), *PLAIN[1:]]
    measured = np.array([0.5, -0.2, 0.8]) @ A
    found = fit(formula(linear, measured, bounded), ZERO, "abc", 10)
    others = np.linalg.lstsq(A[1:].T, measured - 0.25 * A[0], rcond=None)[0]
    assert found.converged and found.values["a"] == 0.25
    # To first order in the decrement at which the fit ends.
    np.testing.assert_allclose([found.values["b"], found.values["c"]], others, atol=DECREMENT / 3)


def test_a_parameter_leaves_its_bound_when_the_data_pull_it_inside() -> None:
    bounded = [Parameter("a", "", 0.0, 1.0, 0.0, 10.0), *PLAIN[1:]]
    found = fit(formula(linear, np.array([0.5, -0.2, 0.8]) @ A, bounded), ZERO, "abc", 5)
    assert found.values["a"] == pytest.approx(0.5)


def test_a_trial_that_cannot_be_simulated_is_shortened() -> None:
    def brittle(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise SolverError("the step could not be solved")
        return 10 * p, np.array([[10.0]])

    objective = formula(brittle, np.array([10.0]), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 3)
    assert [point["a"] for point in objective.tried[:3]] == pytest.approx([0.0, 1.0, 0.4])
    assert 0.4 <= found.values["a"] <= 0.7 and np.all(np.diff(costs(found)) < 0)
    assert not found.converged and "σ" in found.reason


def test_a_trial_at_which_a_term_has_no_value_is_shortened() -> None:
    def brittle(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise InputError("the term has a value that is not finite")
        return 10 * p, np.array([[10.0]])

    found = fit(formula(brittle, np.array([10.0]), PLAIN[:1]), {"a": 0.0}, "a", 3)
    assert 0.4 <= found.values["a"] <= 0.7


def test_a_fault_of_the_program_in_a_trial_is_raised() -> None:
    def faulty(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise ValueError("operands could not be broadcast together")
        return 10 * p, np.array([[10.0]])

    with pytest.raises(ValueError, match="broadcast"):
        fit(formula(faulty, np.array([10.0]), PLAIN[:1]), {"a": 0.0}, "a", 3)


@pytest.mark.parametrize("status", [Status.OUT_OF_TIME, Status.NOT_CONVERGED])
def test_a_trial_whose_job_failed_is_shortened_and_told_in_one_line(
    status: Status, lines: list[str]
) -> None:
    error = JobError("bar", status, "limit 5 s", "the end\nof the log", "results/jobs/key")

    def brittle(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise error
        return 10 * p, np.array([[10.0]])

    objective = formula(brittle, np.array([5.0]), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 3)
    assert found.values["a"] == pytest.approx(0.5)
    objective = formula(brittle, np.array([10.0]), PLAIN[:1])
    lines.clear()
    found = fit(objective, {"a": 0.0}, "a", 3)
    assert [point["a"] for point in objective.tried[:3]] == pytest.approx([0.0, 1.0, 0.4])
    told = [line for line in lines if "a trial point failed" in line]
    assert len(told) == sum(point["a"] > 0.7 for point in objective.tried)
    assert f": bar: {status} (limit 5 s); " in told[0]
    assert told[0].endswith("; its files are in results/jobs/key")


@pytest.mark.parametrize(
    "error",
    [
        *(JobError("bar", s) for s in (Status.KILLED, Status.NO_RESULT, Status.OUT_OF_MEMORY)),
        *(JobError("bar", s) for s in (Status.BAD_DECK, Status.BROKEN, Status.CRASHED)),
        ResultFileError("job.json: found nothing"),
    ],
    ids=lambda error: str(getattr(error, "status", "result file")),
)
def test_a_trial_that_failed_for_no_reason_of_its_parameters_ends_the_fit(
    error: SolverError,
) -> None:
    def stopped(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise error
        return 10 * p, np.array([[10.0]])

    objective = formula(stopped, np.array([10.0]), PLAIN[:1])
    with pytest.raises(type(error)):
        fit(objective, {"a": 0.0}, "a", 3)
    assert len(objective.tried) == 2


@pytest.mark.parametrize(
    "error",
    [PreparedError([Path("jobs/key")]), CommandMissingError("bar", Status.COMMAND_MISSING)],
    ids=lambda error: type(error).__name__,
)
def test_a_trial_that_was_not_run_ends_the_fit(error: NotRunError) -> None:
    """A shorter step would not be run either, and the point is no worse for it."""

    def unrun(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 0.7:
            raise error
        return 10 * p, np.array([[10.0]])

    objective = formula(unrun, np.array([10.0]), PLAIN[:1])
    with pytest.raises(type(error)):
        fit(objective, {"a": 0.0}, "a", 3)
    assert len(objective.tried) == 2


def test_a_start_that_cannot_be_simulated_is_told() -> None:
    def never(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        raise SolverError("no")

    with pytest.raises(SolverError):
        fit(formula(never, np.zeros(1), PLAIN[:1]), {"a": 0.0}, "a", 3)


def test_the_end_has_its_reason() -> None:
    def wrong_slope(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return -10 * p, np.array([[10.0]])

    def reason(curve: Curve, most: int) -> tuple[bool, str]:
        start = np.array([-1.2, 1.0])
        objective = formula(curve, np.array([0.0, 1.0]), PLAIN[:2])
        values = dict(zip("ab", start, strict=True))
        found = fit(objective, values, "ab", most, tolerance=1e-6)
        return found.converged, found.reason

    assert reason(rosenbrock, 100) == (True, reason(rosenbrock, 100)[1])
    assert reason(rosenbrock, 100)[1].startswith("the Newton decrement is")
    assert reason(rosenbrock, 1)[1].startswith("the limit of 1 iterations, decrement")
    assert reason(rosenbrock, 1)[0] is False
    objective = formula(wrong_slope, np.array([10.0]), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 5)
    assert not found.converged and found.values["a"] == 0.0
    assert found.reason.startswith("no shorter step lowers the cost")
    assert len(objective.tried) == 1 + MOST_HALVINGS + 1  # one goes on from the full step


def displaced(noise: float, by: float) -> tuple[Formula, dict[str, float]]:
    """A linear problem of one parameter, started `by` standard deviations off its optimum."""
    measured = noise * np.random.default_rng(0).standard_normal(40)
    length = np.linalg.norm(A[0])
    return formula(linear, measured, PLAIN), ZERO | {
        "a": float(A[0] @ measured / length**2 + by / length)
    }


def test_a_fit_that_only_starts_another_ends_early() -> None:
    objective, start = displaced(noise=1.0, by=3.0)
    early = fit(objective, start, "a", 5, share=0.5)
    assert early.converged and len(early.history) == 1
    assert len(fit(objective, start, "a", 5, share=0.01).history) == 2


def test_a_fit_that_only_starts_another_ends_after_a_step_that_brought_little() -> None:
    objective, start = displaced(noise=1.0, by=3.0)
    found = fit(objective, start, "a", 5, share=0.2, tolerance=1e-9)
    assert found.converged and found.reason.startswith("the Newton decrement")
    # A curve that flattens: each step promises more than it brings.
    slow = formula(lambda p: (100 + 50 / (1 + p), -50 / (1 + p)[None] ** 2), np.zeros(1), PLAIN[:1])
    found = fit(slow, {"a": 0.0}, "a", 50, share=0.05)
    assert found.converged and found.reason.startswith("the last step lowered the cost by")


def test_a_gain_that_derivatives_promise_and_that_never_comes_is_not_waited_for() -> None:
    """A residual of 5 that the slope, wrong by a twentieth, claims to see: decrement 0.3 σ."""
    right, wrong = np.zeros((1, 60)), np.zeros((1, 60))
    right[0, 0], wrong[0, :2] = 10.0, (10.0, 0.5)
    measured = np.concatenate([[0.05, 5.0], np.zeros(58)])
    objective = formula(lambda p: (p @ right, wrong), measured, PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 20)
    assert found.converged and len(found.history) == 2


def after_the_start(first: FloatArray, later: FloatArray) -> tuple[Fit, int]:
    """A fit started at its optimum, and its evaluations: they err by one vector, then another."""
    calls = []

    def erring(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        calls.append(p)
        return p @ A + (first if len(calls) == 1 else later), A

    measured = np.ones(40)
    best = np.linalg.solve(A @ A.T, A @ measured)
    start = dict(zip("abc", best, strict=True))
    return fit(formula(erring, measured, PLAIN), start, "abc", 20), len(calls)


ALONG = A[0] / np.linalg.norm(A[0])


def test_near_the_optimum_a_step_that_ends_the_score_is_right_though_the_cost_rises() -> None:
    """Its derivatives do not know the noise of each image, by which the cost rises."""
    across = np.ones(40) - A.T @ np.linalg.solve(A @ A.T, A @ np.ones(40))
    found, calls = after_the_start(-0.5 * ALONG, -0.5 * ALONG - across)
    assert found.converged and found.reason.startswith("the Newton decrement") and calls == 2
    costs_of = costs(found)
    assert costs_of[1] > costs_of[0]


def test_where_a_small_step_lowers_neither_cost_nor_score_the_fit_ends() -> None:
    """Each evaluation errs anew, as by time steps of its own."""
    found, calls = after_the_start(-0.2 * ALONG, 0.2 * ALONG)
    assert found.converged and "does not lower the cost" in found.reason
    assert calls == 1 + 3 < 1 + MOST_HALVINGS


def test_a_prior_may_raise_the_misfit() -> None:
    """From the optimum of the data to that of data and prior: the cost falls all the same."""
    measured = RNG.standard_normal(40)
    prior = {"a": (3.0, 0.05)}
    start = np.linalg.lstsq(A.T, measured, rcond=None)[0]
    objective = formula(linear, measured, PLAIN, prior)
    found = fit(objective, dict(zip("abc", start, strict=True)), "abc", 9)
    assert found.converged and found.reason.startswith("the Newton decrement is")
    assert found.best.misfit > objective.evaluate(found.values | {"a": start[0]}, "abc").misfit
    assert found.values["a"] > 2.5


def test_where_a_model_error_stays_a_step_that_changes_nothing_is_not_taken() -> None:
    objective, start = displaced(noise=300.0, by=3.0)
    found = fit(objective, start, "a", 5)
    assert found.converged and len(found.history) == 1
    objective, start = displaced(noise=1.0, by=3.0)
    assert len(fit(objective, start, "a", 5).history) == 2


def test_a_fit_that_ends_far_from_zero_says_why_that_is_enough() -> None:
    objective, start = displaced(noise=300.0, by=3.0)
    found = fit(objective, start, "a", 5)
    excess = found.best.excess - SCATTER * np.sqrt(2 * 40)
    assert 9.0 < 0.01 * excess
    assert found.reason == (
        "the Newton decrement is 3 σ, so that a step would gain 9, less than 1% of the misfit "
        f"beyond noise, {excess:.3g}, which no parameter takes away"
    )
    objective, start = displaced(noise=1.0, by=3.0)
    assert "that only starts the next one" in fit(objective, start, "a", 5, share=0.5).reason
    assert fit(objective, start, "a", 5).reason.endswith(" σ")


def test_a_short_step_is_no_sign_of_being_near() -> None:
    """A parameter 10⁵ trusted ranges away lowers the cost little in each step, and goes on."""
    objective = formula(lambda p: (1e3 * p, np.array([[1e3]])), np.array([1e6]), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 4)
    assert not found.converged and found.reason.startswith("the limit of 4 iterations")
    assert found.values["a"] == pytest.approx(4 * LARGEST_STEP, rel=0.5)


def test_an_evaluation_that_is_known_already_is_not_repeated() -> None:
    objective = formula(linear, np.ones(40), PLAIN)
    start = objective.evaluate(ZERO, "abc")
    objective.tried.clear()
    found = fit(objective, ZERO, "abc", 0, start=start)
    assert objective.tried == [] and found.best is start


def test_a_fit_keeps_the_load_with_which_it_began_and_its_duration() -> None:
    objective = formula(linear, np.ones(40), PLAIN)
    start = replace(objective.evaluate(ZERO, "abc"), load=np.array([3.0, 5.0]))
    found = fit(objective, ZERO, "abc", 5, start=start)
    assert found.best is not start
    np.testing.assert_array_equal(found.start_load, [3.0, 5.0])
    assert found.seconds > 0


def test_restricting_an_evaluation_is_evaluating_with_fewer_free() -> None:
    objective = formula(linear, np.ones(40), PLAIN, {"b": (0.1, 0.3)})
    values = ZERO | {"b": 0.4}
    fewer = objective.restrict(objective.evaluate(values, "abc"), ("c", "b"))
    anew = objective.evaluate(values, ("c", "b"))
    assert fewer.free == anew.free
    np.testing.assert_array_equal(fewer.hessian, anew.hessian)
    np.testing.assert_array_equal(fewer.gradient, anew.gradient)
    assert fewer.cost == pytest.approx(anew.cost)


def test_notes_of_the_solver_are_told_with_the_iteration(
    lines: list[str],
) -> None:
    objective = formula(linear, np.array([0.5, -0.2, 0.8]) @ A, PLAIN, {})
    start = objective.evaluate(ZERO, tuple("abc"))
    response = replace(start.prediction.response, notes=("doubtful",))
    noted = replace(start, prediction=replace(start.prediction, response=response))
    fit(objective, ZERO, "abc", 1, noted)
    assert lines[1] == "    doubtful" and lines[0].startswith("  iteration 0")
    assert lines[2].startswith("  iteration 1") and len(lines) == 4
    assert lines[3].startswith("  ended: the Newton decrement is")


@pytest.mark.parametrize(("excess", "steps"), [(1.5, 1), (12.0, 0)], ids=["scatter", "excess"])
def test_only_misfit_beyond_the_scatter_of_noise_makes_a_step_negligible(
    excess: float, steps: int
) -> None:
    """A parameter one standard deviation off, in so many deviations of ‖r‖² above its mean."""
    n = 20_000
    curve = np.zeros((1, n))
    curve[0, 0] = 1.0
    measured = np.full(n, np.sqrt(1 + excess * np.sqrt(2 / n)))
    measured[0] = 1.0

    def one(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return p @ curve, curve

    found = fit(formula(one, measured, PLAIN[:1]), {"a": 0.0}, "a", 5)
    assert found.converged and len(found.history) == 1 + steps


def test_what_an_excess_makes_negligible_is_fitted_where_the_parameter_is_told() -> None:
    """The line is met at once; the excess is noise along no parameter."""
    n = 20_000
    line = np.zeros((1, n))
    line[0, 0] = 1.0
    measured = np.full(n, np.sqrt(1 + 12.0 * np.sqrt(2 / n)))
    measured[0] = 2.5

    def one(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return p @ line, line

    objective = formula(one, measured, PLAIN[:1])
    early = fit(objective, {"a": 0.0}, "a", 5)
    assert early.converged and early.values["a"] == 0.0
    end = to_its_end(early, objective, 5)
    assert end.converged and end.values["a"] == pytest.approx(2.5)
    assert end.away_from(early.best, objective.parameters) == pytest.approx(2.5)
    assert len(end.history) == 2 and end.history[0] == early.history[0]
    stuck = replace(early, converged=False)
    assert to_its_end(early, objective, 0).reason == early.reason  # no step was left to take
    assert to_its_end(end, objective, 5) is end and to_its_end(stuck, objective, 5) is stuck


def test_a_fit_is_given_up_where_a_step_promises_too_little_though_the_first_promised_enough(
    lines: list[str],
) -> None:
    """The first step is promised the floor of a straight valley, but this one levels off."""

    def levelling(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        x = float(p[0])
        return np.array([np.tanh(x), x / 40]), np.array([[np.cosh(x) ** -2, 1 / 40]])

    objective = formula(levelling, np.array([3.0, 0.0]), [Parameter("x", "", 0.0, 1.0)])
    whole = fit(objective, {"x": 0.0}, ("x",), 30)
    assert whole.converged and whole.best.cost > 4
    assert promised(objective, objective.evaluate({"x": 0.0}, ("x",))) < 1
    ended = fit(objective, {"x": 0.0}, ("x",), 30, threshold=1.0)
    assert ended.given_up and not ended.converged and 1 < len(ended.history) < len(whole.history)
    assert lines[-1] == "  NOT converged: a step promises too little"
    assert not fit(objective, {"x": 0.0}, ("x",), 30, threshold=whole.best.cost + 1).given_up


@pytest.mark.parametrize(("measured", "converged"), [(0.35, True), (10.0, False)])
def test_a_fit_whose_steps_gain_nothing_has_converged_only_where_they_promise_little(
    measured: float, converged: bool
) -> None:
    """The derivative promises all of the misfit, and next to nothing comes."""

    def hardly(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([2e-4 * bool(p[0])]), np.array([[1.0]])

    objective = formula(hardly, np.array([measured]), [Parameter("x", "", 0.0, 1.0)])
    found = fit(objective, {"x": 0.0}, ("x",), 9)
    assert found.reason.startswith("the last step lowered the cost by 0.00")
    assert found.converged == converged

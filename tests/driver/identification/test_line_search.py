from __future__ import annotations

import numpy as np
import pytest

from driver.identification.fit import Fit, fit
from driver.identification.gauss_newton_step import LARGEST_STEP
from driver.identification.line_search import newton, promised
from meshes.arrays import FloatArray
from solver_adapters.interface import SolverError
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.status import Status
from solver_adapters.parameter import Parameter
from tests.driver.analytic import Curve, bent, formula, rosenbrock

PLAIN = [Parameter("a", "", 0.0, 1.0), Parameter("b", "", 0.0, 0.5)]


def costs(found: Fit) -> list[float]:
    return [record["cost"] for record in found.history]


def straight(p: FloatArray) -> tuple[FloatArray, FloatArray]:
    slopes = np.array([[3.0, 1.0, 0.0], [0.0, 2.0, 1.0]])
    return p @ slopes, slopes


@pytest.mark.parametrize("far", [1.0, 100.0], ids=["in full", "damped"])
def test_of_a_linear_model_a_step_keeps_its_promise_damped_or_not(far: float) -> None:
    objective = formula(straight, far * np.array([3.0, -4.0, 2.0]), PLAIN, {"b": (0.3, 0.4)})
    start = objective.evaluate({"a": 0.0, "b": 0.0}, "ab")
    found = fit(objective, start.values, "ab", 1, start=start)
    assert found.best.cost == pytest.approx(promised(objective, start), rel=1e-9)
    step, decrement = newton(objective, start)
    whole = start.cost - decrement**2
    assert found.best.cost >= whole * (1 - 1e-9)
    if far == 1.0:
        assert found.best.cost == pytest.approx(whole)
    else:
        assert np.max(np.abs(step)) <= LARGEST_STEP and found.best.cost > 1.1 * whole


def test_a_full_step_up_the_side_of_a_bent_valley_is_taken_where_the_next_leads_below(
    lines: list[str],
) -> None:
    """Steps short enough never to climb need many iterations, with trial points of their own."""
    objective = formula(bent, np.array([0.0, 1.0]), PLAIN[:2])
    found = fit(objective, {"a": -1.2, "b": 1.0}, "ab", 100, tolerance=1e-6)
    assert found.converged and len(objective.tried) == 4
    np.testing.assert_allclose([found.values["a"], found.values["b"]], 1.0, atol=1e-5)
    climbed = objective.evaluate(objective.tried[1], "ab").cost
    assert climbed > 5 * costs(found)[0] and np.all(np.diff(costs(found)) < 0)
    assert [line for line in lines if "climbs" in line] == [
        "    the step climbs; 1 more brought it well below where it began"
    ]


def residuals(*path: tuple[float, float]) -> Curve:
    """Residual and slope of one parameter at the first, second, … point; each promises none."""
    met = iter(path)

    def curve(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        value, slope = next(met)
        return np.array([-value]), np.array([[slope]])

    return curve


def ended_after(*path: tuple[float, float]) -> tuple[Fit, list[float]]:
    objective = formula(residuals(*path), np.zeros(1), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 1)
    return found, [point["a"] for point in objective.tried]


def numbers(*path: tuple[float, float, float]) -> Curve:
    """Like `residuals`, beside a number on which no derivative says anything."""
    met = iter(path)

    def curve(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        value, slope, beside = next(met)
        return np.array([-value, -beside]), np.array([[slope, 0.0]])

    return curve


# A full step of 2.15 from the first leads to the second, which is higher and promises less, and one
# as long from there leads back, which is lower.
HERE, THERE = (2.15, 1.0, 1.0), (-0.9, 0.9 / 2.15, 2.5)


def test_steps_that_go_to_and_fro_are_followed_by_the_point_where_the_slope_turns() -> None:
    objective = formula(numbers(HERE, THERE, HERE, (0.05, 1.0, 1.0)), np.zeros(2), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 9)
    tried = [point["a"] for point in objective.tried]
    there, here = 0.9 * 0.9 / 2.15, 2.15
    assert tried == pytest.approx([0.0, 2.15, 0.0, 2.15 * here / (here + there)])
    assert found.converged and found.values["a"] == tried[-1] and len(found.history) == 3


@pytest.mark.parametrize(
    "last", [(1.0, 1.0, 1.0), (2.2, 1.0, 0.0)], ids=["no nearer to the end", "farther from it"]
)
def test_where_the_slope_turns_no_nearer_to_the_end_the_steps_go_on(
    last: tuple[float, float, float],
) -> None:
    objective = formula(numbers(HERE, THERE, HERE, last), np.zeros(2), PLAIN[:1])
    found = fit(objective, {"a": 0.0}, "a", 2)
    assert len(objective.tried) == 4 and found.at_limit
    assert found.values["a"] == pytest.approx(0.0, abs=1e-9)


def test_steps_that_lead_lower_each_time_go_not_to_and_fro() -> None:
    lower, lowest = (-2.0, 0.9 / 2.15, 0.5), (1.9, 1.0, 0.0)
    objective = formula(numbers(HERE, lower, lowest), np.zeros(2), PLAIN[:1])
    fit(objective, {"a": 0.0}, "a", 2)
    assert len(objective.tried) == 3


UP, HIGH = (15.0, 15.0), (12.0, 12.0)
SHORTER = (9.0, 10.0)


def test_two_more_steps_may_lead_below_where_one_began() -> None:
    found, tried = ended_after((10.0, 10.0), UP, HIGH, (3.0, 10.0))
    assert tried == pytest.approx([0.0, 1.0, 2.0, 3.0])
    assert costs(found) == pytest.approx([100.0, 9.0])


def test_a_step_from_which_two_more_do_not_lead_below_is_shortened() -> None:
    found, tried = ended_after((10.0, 10.0), UP, HIGH, (11.0, 11.0), SHORTER)
    assert tried == pytest.approx([0.0, 1.0, 2.0, 3.0, 0.4])
    assert costs(found) == pytest.approx([100.0, 81.0])


def test_a_step_from_which_the_next_climbs_further_is_shortened() -> None:
    found, tried = ended_after((10.0, 10.0), UP, (16.0, 16.0), SHORTER)
    assert tried == pytest.approx([0.0, 1.0, 2.0, 0.4]) and costs(found)[-1] == pytest.approx(81.0)


def test_a_way_over_a_rise_that_gains_next_to_nothing_is_not_taken() -> None:
    """As Newton's method may go to and fro between two points for ever."""
    found, tried = ended_after((10.0, 10.0), UP, (9.9, 10.0), (9.8, 10.0), SHORTER)
    assert tried[-1] == pytest.approx(0.4) and costs(found)[-1] == pytest.approx(81.0)


def test_from_far_above_nothing_is_followed() -> None:
    found, tried = ended_after((10.0, 10.0), (40.0, 40.0), SHORTER)
    assert tried == pytest.approx([0.0, 1.0, 0.4]) and costs(found)[-1] == pytest.approx(81.0)


@pytest.mark.parametrize("killed", [False, True])
def test_a_step_up_after_which_none_can_be_simulated_is_shortened(
    killed: bool, lines: list[str]
) -> None:
    failed = JobError("bar", Status.KILLED) if killed else SolverError("not solved")

    def brittle(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        if p[0] > 1.5:
            raise failed
        rest = {0.0: 10.0, 0.4: 9.0}.get(round(float(p[0]), 1), 15.0)
        return np.array([-rest]), np.array([[rest]])

    objective = formula(brittle, np.zeros(1), PLAIN[:1])
    if killed:
        with pytest.raises(JobError):
            fit(objective, {"a": 0.0}, "a", 1)
        return
    found = fit(objective, {"a": 0.0}, "a", 1)
    assert [point["a"] for point in objective.tried] == pytest.approx([0.0, 1.0, 2.0, 0.4])
    assert costs(found)[-1] == pytest.approx(81.0)
    assert len([line for line in lines if "a trial point failed" in line]) == 1


def test_a_curved_valley_with_high_sides_is_followed_to_its_end_and_never_uphill() -> None:
    objective = formula(rosenbrock, np.array([0.0, 1.0]), PLAIN[:2])
    found = fit(objective, {"a": -1.2, "b": 1.0}, "ab", 100, tolerance=1e-6)
    assert found.converged and len(objective.tried) > 10
    np.testing.assert_allclose([found.values["a"], found.values["b"]], 1.0, atol=1e-5)
    assert np.all(np.diff(costs(found)) < 0)


def test_a_step_that_climbs_and_leads_nowhere_is_shortened() -> None:
    """Newton's method for the root of the arc tangent diverges from beyond 1.39."""

    def arctan(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return 10 * np.arctan(p), 10 / (1 + p[None] ** 2)

    objective = formula(arctan, np.zeros(1), PLAIN[:1])
    found = fit(objective, {"a": 1.5}, "a", 9, tolerance=1e-6)
    start, up, further, back = (point["a"] for point in objective.tried[:4])
    assert up < -start and further > start and back == pytest.approx(start + 0.4 * (up - start))
    assert found.converged and abs(found.values["a"]) < 1e-6 and np.all(np.diff(costs(found)) < 0)


def test_a_step_up_that_promises_nothing_better_is_shortened_at_once() -> None:
    def jumping(p: FloatArray) -> tuple[FloatArray, FloatArray]:
        return np.array([10 * p[0], 30 * (p[0] > 0.7)]), np.array([[10.0, 0.0]])

    objective = formula(jumping, np.array([10.0, 0.0]), PLAIN[:1])
    fit(objective, {"a": 0.0}, "a", 1)
    assert [point["a"] for point in objective.tried] == pytest.approx([0.0, 1.0, 0.4])

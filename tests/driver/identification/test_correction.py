from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.identification.correction import Correction, SecondMesh, correction
from driver.identification.fit import fit
from driver.identification.identify import with_correction
from driver.parameters.boundary import LAMBDAS, elongation_names
from solver_adapters.interface import Capabilities, Trajectory
from tools import closed_form
from tools.closed_form import LAW, SIZES
from tools.closed_form_diagnosis import finer, priors

BENCH = closed_form.problem()
FREE = (*LAMBDAS, *elongation_names(5), *LAW, "tau0_grain2")
AWAY = {"tau0": 0.08, "d": -0.1, "lambda_plus_Y": 0.2, "tau0_grain2": 0.1}
"""Relative changes of parameters."""


def fine_model(by: float = 0.03) -> ForwardModel:
    return finer(BENCH, by)


def away(share: float) -> dict[str, float]:
    values = dict(BENCH.truth)
    return values | {name: values[name] * (1 + share * change) for name, change in AWAY.items()}


@cache
def taken() -> tuple[Prediction, Correction]:
    """The working prediction at the truth, and the correction with its derivatives there."""
    here = BENCH.model.predict(BENCH.truth, FREE)
    return here, correction(BENCH.model, fine_model(), here, BENCH.truth, free=FREE)


def missed(share: float, change: Correction) -> tuple[float, float]:
    """What the corrected prediction lacks of the finer one some way off: motion [nm], load [µN]."""
    values = away(share)
    coarse, fine = (m.predict(values) for m in (BENCH.model, fine_model()))
    there = change.at(values)
    motion = fine.motion - coarse.motion - there.motion
    load = fine.load - coarse.load - there.load
    return 1e3 * float(np.abs(motion).max()), float(np.abs(load).max())


def test_the_corrected_prediction_follows_the_finer_simulation_to_first_order() -> None:
    _, change = taken()
    constant = replace(change, derivatives=None)
    for near, far, fixed in zip(
        missed(0.5, change), missed(1.0, change), missed(1.0, constant), strict=True
    ):
        assert far < 0.3 * fixed
        assert far / near == pytest.approx(4.0, rel=0.25)


def test_where_it_was_taken_it_is_the_difference_of_both_predictions() -> None:
    here, change = taken()
    fine = fine_model().predict(BENCH.truth)
    there = change.at(BENCH.truth)
    np.testing.assert_allclose(here.motion + there.motion, fine.motion, atol=1e-12)
    np.testing.assert_allclose(here.load + there.load, fine.load, rtol=1e-12)


def test_the_jacobian_of_a_corrected_prediction_is_that_of_the_finer_simulation() -> None:
    here, change = taken()
    made = closed_form.objective(BENCH, BENCH.truth)
    corrected = replace(made, correction=change).expect(here, BENCH.truth, FREE)
    fine = replace(made, model=fine_model()).evaluate(BENCH.truth, FREE)
    assert np.abs(made.expect(here, BENCH.truth, FREE).jacobian - fine.jacobian).max() > 0.1
    np.testing.assert_allclose(corrected.jacobian, fine.jacobian, atol=1e-6)


def test_parameters_without_derivatives_have_those_of_the_working_prediction() -> None:
    here, change = taken()
    made = replace(closed_form.objective(BENCH, BENCH.truth), correction=change)
    names = ("skin_tau0", *FREE)
    wide = made.evaluate(BENCH.truth, names)
    plain = replace(made, correction=Correction()).evaluate(BENCH.truth, names)
    np.testing.assert_array_equal(wide.jacobian[0], plain.jacobian[0])
    narrow = made.compare(here, BENCH.truth, FREE)
    np.testing.assert_allclose(wide.jacobian[1:], narrow.jacobian, atol=1e-9)


def test_a_fit_that_begins_afar_ends_where_that_of_the_finer_simulation_does() -> None:
    """A constant correction ends where the parameters have made up for what it lacks there."""
    made = replace(closed_form.objective(BENCH, BENCH.truth), prior=priors(BENCH.truth))
    start, fine = away(1.0), fine_model(0.2)
    wanted = fit(replace(made, model=fine), start, FREE, 12)
    ends = []
    for derivatives in (True, False):
        here = made.evaluate(start, FREE)
        change = correction(made.model, fine, here.prediction, start, free=FREE)
        change = change if derivatives else replace(change, derivatives=None)
        ends.append(fit(replace(made, correction=change), start, FREE, 12))
    off = [
        max(
            abs(end.values[name] - wanted.values[name]) / wanted.sigma(name, made.parameters)
            for name in FREE
        )
        for end in ends
    ]
    assert off[0] < 0.3 * off[1] and off[1] > 0.2


def test_derivatives_that_cost_simulations_are_not_asked_for() -> None:
    class ByDifferences(closed_form.ClosedFormSolver):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), runs_per_direction=2)

    here, _ = taken()
    fine = replace(BENCH.model, adapter=ByDifferences(0.03))
    change = correction(BENCH.model, fine, here, BENCH.truth, free=FREE)
    assert change.derivatives is None and change.at(away(1.0)) is change


def test_a_correction_taken_elsewhere_takes_over_the_derivatives_that_it_lacks() -> None:
    _, before = taken()
    values, few = away(1.0), ("tau0", "skin_tau0")
    here = BENCH.model.predict(values, few)
    again = correction(BENCH.model, fine_model(), here, values, free=few)
    both = again.completed_by(before)
    np.testing.assert_array_equal(both.at(values).load, again.load)
    np.testing.assert_array_equal(both.at(values).motion, again.motion)
    assert both.derivatives is not None and again.derivatives is not None
    names = [p.name for p in both.derivatives.parameters]
    assert names == [*few, *(name for name in FREE if name != "tau0")]
    data = closed_form.objective(BENCH, BENCH.truth).data
    own = both.derivatives.sensitivity(data, few)
    np.testing.assert_array_equal(own, again.derivatives.sensitivity(data, few))
    assert before.derivatives is not None
    lacking = both.derivatives.sensitivity(data, ("d",))
    slopes = values["d"] / BENCH.truth["d"]  # of θ, a logarithm
    taken_over = slopes * before.derivatives.sensitivity(data, ("d",))
    np.testing.assert_allclose(lacking, taken_over, rtol=1e-9, atol=1e-12)


def test_of_a_constant_correction_nothing_is_taken_over() -> None:
    _, before = taken()
    constant = replace(before, derivatives=None)
    assert before.completed_by(constant) is before and constant.completed_by(before) is constant


CONTRAST = "tau0_grain2"
FAR = away(0.1) | {CONTRAST: 1.4 * BENCH.truth[CONTRAST]}
COURSE = Trajectory(np.zeros(2), np.zeros((2, 3, 3)))


def far_off() -> Correction:
    """The correction at another contrast, and at others of all that was fitted."""
    end = correction(BENCH.model, fine_model(), BENCH.model.predict(FAR), FAR)
    return replace(end, course=COURSE)


def straight(derivatives: bool) -> tuple[Correction, Correction]:
    """The correction at the truth, and what goes straight from it to that far off."""
    begin = taken()[1] if derivatives else replace(taken()[1], derivatives=None)
    parameter = BENCH.model.parameters[CONTRAST]
    return begin, begin.through(far_off(), FAR, BENCH.truth[CONTRAST], parameter)


@pytest.mark.parametrize("derivatives", [True, False])
def test_a_correction_that_goes_straight_to_another_one_is_either_where_that_was_taken(
    derivatives: bool,
) -> None:
    begin, change = straight(derivatives)
    end = far_off()
    for at, known in ((BENCH.truth, begin), (FAR, end)):
        np.testing.assert_allclose(change.at(at).load, known.load, rtol=1e-12)
        np.testing.assert_allclose(change.at(at).motion, known.motion, atol=1e-15)
    assert change.at(FAR).is_constant and not change.is_constant
    assert change.course is COURSE


@pytest.mark.parametrize("derivatives", [True, False])
def test_what_goes_straight_along_one_parameter_keeps_the_derivatives_for_all_others(
    derivatives: bool,
) -> None:
    begin, change = straight(derivatives)
    halfway = {CONTRAST: np.sqrt(1.4) * BENCH.truth[CONTRAST]}
    for here in (BENCH.truth, FAR):
        ends = [
            np.asarray(change.at(here | {CONTRAST: at[CONTRAST]}).load) for at in (BENCH.truth, FAR)
        ]
        np.testing.assert_allclose(change.at(here | halfway).load, 0.5 * sum(ends), rtol=1e-12)
    other = BENCH.truth | {"tau0": 1.01 * BENCH.truth["tau0"]}
    np.testing.assert_allclose(change.at(other).load, begin.at(other).load, rtol=1e-12)


def test_what_goes_straight_begins_where_a_correction_holds_though_it_was_taken_elsewhere() -> None:
    """A cause that was taken out again stands at its null, and its correction knows it there."""
    _, begin = taken()
    null = BENCH.truth | {CONTRAST: 0.9 * BENCH.truth[CONTRAST]}
    change = begin.through(far_off(), FAR, null[CONTRAST], BENCH.model.parameters[CONTRAST])
    for at, known in ((null, begin.at(null)), (FAR, far_off())):
        np.testing.assert_allclose(change.at(at).load, known.load, rtol=1e-12)


@pytest.mark.parametrize("derivatives", [True, False])
def test_the_jacobian_of_what_goes_straight_is_its_difference_quotient(derivatives: bool) -> None:
    _, change = straight(derivatives)
    data, step = closed_form.objective(BENCH, BENCH.truth).data, 1e-5
    for k, name in enumerate(("tau0", CONTRAST)):
        rows = change.sensitivity(data, ("tau0", CONTRAST))
        assert rows is not None
        up, down = (
            change.at(FAR | {name: FAR[name] * np.exp(sign * step)}) for sign in (1.0, -1.0)
        )
        motion, load = (
            np.asarray(getattr(up, part)) - np.asarray(getattr(down, part))
            for part in ("motion", "load")
        )
        quotient = data.change(motion, load) / (2 * step)
        np.testing.assert_allclose(rows[k], quotient, atol=1e-6 * np.abs(rows).max())
        assert bool(np.any(quotient)) == (derivatives or name == CONTRAST)


def of(motion: float, load: float) -> Correction:
    return Correction(np.full((2, 3, 3), motion), np.full(2, load))


def test_a_better_second_mesh_takes_the_place_of_the_first() -> None:
    better = SecondMesh(of(0.5e-3, -1.0), 0.667)
    together = of(1e-3, 2.0).with_second(better)
    np.testing.assert_allclose(together.motion, 1.5e-3)
    np.testing.assert_allclose(together.load, 1.0)
    assert better.is_better and better.off is None


def test_two_meshes_as_good_as_each_other_judge_by_their_mean() -> None:
    alike = SecondMesh(of(0.5e-3, -1.0))
    together = of(1e-3, 2.0).with_second(alike)
    np.testing.assert_allclose(together.motion, 1.25e-3)
    np.testing.assert_allclose(together.load, 1.5)
    assert not alike.is_better and alike.off is not None
    np.testing.assert_allclose(alike.off.motion, 0.25e-3)
    np.testing.assert_allclose(alike.off.load, -0.5)


def test_without_a_second_mesh_a_correction_is_what_it_is() -> None:
    first = of(1e-3, 2.0)
    assert first.with_second(None) is first and first.without_second(None) is first


@pytest.mark.parametrize("size", [0.667, None])
def test_what_a_second_mesh_added_can_be_taken_off_again(size: float | None) -> None:
    second = SecondMesh(of(0.5e-3, -1.0), size)
    again = of(1e-3, 2.0).with_second(second).without_second(second)
    np.testing.assert_allclose(again.motion, 1e-3)
    np.testing.assert_allclose(again.load, 2.0)


def test_the_covariance_is_that_of_what_the_better_mesh_leaves_and_of_equals_that_of_either() -> (
    None
):
    objective = closed_form.objective(BENCH, BENCH.truth)
    rng = np.random.default_rng(5)
    T, n_pix = len(BENCH.history.time), len(objective.data.image.images.xy)
    first, more = (
        Correction(1e-3 * rng.standard_normal((T, n_pix, 3)), rng.standard_normal(T))
        for _ in range(2)
    )
    whole = Correction(np.asarray(first.motion) + more.motion, np.asarray(first.load) + more.load)
    small = (SIZES[0], 0.5 * SIZES[1])
    for second, change, sizes in (
        (SecondMesh(more, small[1]), whole, small),
        (SecondMesh(more), first, SIZES),
    ):
        found = with_correction(objective, 1.0, first, SIZES, second)
        expected = with_correction(objective, 1.0, change, sizes).data.simulation_error
        left = found.data.simulation_error
        assert left is not None and expected is not None and found.second is second
        np.testing.assert_allclose(abs(left.shapes), abs(expected.shapes), rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(left.load, expected.load, rtol=1e-12)
        assert found.sizes_behind(SIZES) == sizes
    plain = with_correction(objective, 1.0, first, SIZES)
    assert plain.second is None and plain.sizes_behind(SIZES) == SIZES

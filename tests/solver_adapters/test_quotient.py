"""A derivative from three runs, whose exact value is that of a curve."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from meshes.arrays import FloatArray
from solver_adapters.interface import Direction, Response
from solver_adapters.quotient import (
    ASYMMETRY,
    MOST_STEPS,
    Slope,
    best_of,
    following_step,
    slope_through,
)

DIRECTION = Direction("tau0", material={"tau0": 1.0}, scale=4.0)


def response(x: float, curvature: float = 0.0, ends: tuple[float, ...] = ()) -> Response:
    """Two forces, f = 1 + 3 x + curvature x² and its double, and one displacement 2 x."""
    force = (1 + 3 * x + curvature * x**2) * np.array([1.0, 2.0])
    return Response(
        displacement=np.full((2, 1, 3), 1 + 2 * x),
        force=force,
        d_displacement=np.zeros((0, 2, 1, 3)),
        d_force=np.zeros((0, 2)),
        steps=len(ends),
        ends=np.array(ends),
    )


def slope(a: float, b: float, curvature: float = 0.0, noise: float = 1e-9) -> Slope:
    pair = ((a, response(a, curvature)), (b, response(b, curvature)))
    return slope_through(response(0.0, curvature), pair, noise)


@pytest.mark.parametrize("where", [(0.1, -0.1), (0.1, 0.05), (-0.2, 0.1)])
def test_a_parabola_is_differentiated_exactly_from_both_sides_or_one(
    where: tuple[float, float],
) -> None:
    found = slope(*where, curvature=5.0)
    np.testing.assert_allclose(found.force, [3.0, 6.0], rtol=1e-12)
    np.testing.assert_allclose(found.displacement, 2.0, rtol=1e-12)
    assert found.amounts == where


def test_the_asymmetry_is_what_curvature_makes_of_a_one_sided_slope() -> None:
    assert slope(0.1, -0.1).asymmetry < 1e-12
    found = slope(0.1, -0.1, curvature=5.0)
    # A one-sided slope of the force is 3 ± 0.5; sizes are shares of the response, by part.
    size = np.hypot(2.0, 3.0)
    assert found.asymmetry == pytest.approx(0.5 / size, rel=1e-9)


def test_a_small_asymmetry_needs_no_other_step_and_no_word() -> None:
    found = slope(0.001, -0.001, curvature=5.0)
    assert 0 < found.asymmetry < ASYMMETRY
    assert found.better_step(DIRECTION.scale) is None
    assert found.doubts(DIRECTION) == []


def test_curvature_asks_for_a_smaller_step_that_would_do() -> None:
    found = slope(0.1, -0.1, curvature=5.0)
    step = found.better_step(DIRECTION.scale)
    assert step is not None
    assert slope(step, -step, curvature=5.0).asymmetry == pytest.approx(ASYMMETRY / 2)
    (doubt,) = found.doubts(DIRECTION)
    assert doubt.startswith(
        "derivative along 'tau0': uncertain by about 7%, as a slope to one side"
    )


def test_noise_asks_for_a_wider_step_within_half_of_the_scale() -> None:
    found = Slope(
        (0.1, -0.1), np.ones(1), np.ones(1), asymmetry=0.05, uncertainty=0.025, noise=0.04,
        other_steps=0.0, seen=True,
    )  # fmt: skip
    assert found.better_step(4.0) == pytest.approx(0.5)
    assert found.better_step(0.4) == pytest.approx(0.2)


def test_where_nothing_changes_the_widest_step_is_asked_for_and_told() -> None:
    still = response(0.0)
    found = slope_through(still, ((0.1, still), (-0.1, still)), 1e-5)
    assert not found.seen and not found.force.any()
    assert found.better_step(4.0) == pytest.approx(2.0)
    (doubt,) = found.doubts(DIRECTION)
    assert "no change was seen over ± 0.1" in doubt


def test_runs_with_other_time_steps_are_doubted() -> None:
    base, other = (response(0.0, ends=ends) for ends in ((1.0, 2.0), (1.5, 2.0)))
    same = slope_through(base, ((0.1, base), (-0.1, base)), 1e-9)
    assert same.same_steps
    found = slope_through(base, ((0.1, base), (-0.1, other)), 1e-9)
    assert not found.same_steps
    doubt = found.doubts(DIRECTION)[-1]
    assert "took other time steps than the asked one" in doubt


def test_the_digits_of_a_file_make_no_other_time_steps() -> None:
    base, other = (response(0.0, ends=ends) for ends in ((1.2345678, 2.0), (1.234568, 2.0)))
    assert slope_through(base, ((0.1, base), (-0.1, other)), 1e-9).same_steps


def noisy(step: float, amplitude: float) -> Slope:
    """Of runs of which the one on the farther side is off by a part of its force."""
    off = response(-step)
    other = Response(
        off.displacement, off.force * (1 + amplitude), off.d_displacement, off.d_force,
        steps=0, ends=np.array(()),
    )  # fmt: skip
    return slope_through(response(0.0), ((step, response(step)), (-step, other)), amplitude)


def test_two_steps_that_agree_take_the_doubt_away_where_curvature_or_noise_made_it() -> None:
    wide, narrow = slope(0.1, -0.1, curvature=5.0), slope(0.05, -0.05, curvature=5.0)
    assert wide.doubtful and narrow.doubtful
    best = best_of([wide, narrow])
    assert best.amounts == narrow.amounts and not best.doubtful and best.uncertainty < 1e-12
    few, many = noisy(0.01, 1e-2), noisy(0.04, 1e-2)
    assert few.doubtful and many.doubtful
    best = best_of([few, many])
    assert best.amounts == many.amounts
    assert best.uncertainty == min(best.asymmetry / 2, many.apart(few))


def test_two_wide_steps_that_agree_are_taken_where_the_best_narrow_one_is_noisy() -> None:
    """Curvature makes their asymmetry, which the derivative from both sides does not have."""

    def at(step: float) -> Slope:
        return slope_through(
            manufactured(0.0, curvature=20.0),
            (
                (step, manufactured(step, curvature=20.0, jump=1e-4)),
                (-step, manufactured(-step, curvature=20.0, jump=1e-4)),
            ),
            1e-5,
        )

    def error(chosen: Slope) -> float:
        off = chosen.displacement.ravel() - RATES
        return float(np.linalg.norm(off) / np.linalg.norm(RATES))

    narrow, middle, wide = at(0.002), at(0.016), at(0.032)
    assert narrow.doubtful and middle.doubtful and wide.doubtful
    assert min((narrow, middle, wide), key=lambda one: one.asymmetry) is narrow
    best = best_of([narrow, middle, wide])
    assert not best.doubtful and best.step == 0.016
    assert error(best) < 0.002 < 0.01 < error(narrow)


def test_between_two_worse_steps_a_further_one_lies_towards_the_better_of_them() -> None:
    tried = [
        replace(noisy(step, 1e-2), asymmetry=0.1, uncertainty=uncertainty)
        for step, uncertainty in ((0.01, 0.05), (0.02, 0.03), (0.08, 0.04))
    ]
    assert best_of(tried).step == 0.02
    assert following_step(tried, scale=4.0) == pytest.approx(0.04)


def test_a_wider_step_is_tried_where_noise_makes_an_asymmetry_that_one_run_may_cause() -> None:
    """All of the asymmetry may be its error, though only the half is told."""
    certain = replace(noisy(0.02, 1e-2), asymmetry=0.015, uncertainty=0.0075, noise=0.015)
    assert not certain.doubtful and following_step([certain], scale=4.0) == pytest.approx(0.03)
    curved = replace(certain, noise=0.001)
    assert following_step([curved], scale=4.0) is None


def test_a_kink_stays_doubtful_however_many_steps_agree() -> None:
    def bent(step: float) -> Slope:
        runs = (step, response(step)), (-step, response(-0.5 * step))
        return slope_through(response(0.0), runs, 1e-9)

    best = best_of([bent(0.1), bent(0.02), bent(0.3)])
    assert best.doubtful and best.uncertainty == best.asymmetry / 2


def test_a_further_step_goes_on_where_the_last_was_better_and_turns_where_it_was_worse() -> None:
    better = [noisy(0.01, 1e-2), noisy(0.02, 1e-2)]
    assert following_step(better, scale=4.0) == pytest.approx(0.04)
    worse = [noisy(0.02, 1e-2), noisy(0.01, 1e-2)]
    assert following_step(worse, scale=4.0) == pytest.approx(0.04)
    assert following_step(better, scale=0.05) == pytest.approx(0.025)
    tried = [*better, noisy(0.04, 1e-2)]
    assert following_step(tried, scale=4.0) == pytest.approx(0.08)
    tried = [*tried, noisy(0.08, 1e-2)]
    assert following_step([slope(0.001, -0.001)], scale=4.0) is None


def test_after_four_steps_wider_ones_follow_as_far_as_the_most_and_half_of_the_scale() -> None:
    off = {0.08: 0.2, 0.01: 0.05, 0.02: 0.1, 0.04: 0.02, 0.16: 5.0, 0.32: 3.0}
    six = [noisy(step, amplitude) for step, amplitude in off.items()]
    tried = six[:4]
    assert best_of(tried).doubtful
    assert following_step(tried, scale=4.0) == pytest.approx(0.16)
    assert following_step(tried, scale=0.3) is None
    # A step whose runs took other time steps is no reason to go beyond it.
    cut = replace(six[0], other_steps=0.1)
    assert following_step([cut, *tried[1:]], scale=4.0) == pytest.approx(0.08)
    assert len(six) == MOST_STEPS and best_of(six).doubtful
    assert following_step(six, scale=4.0) is None


def test_a_derivative_in_the_same_time_steps_goes_before_one_of_less_asymmetry_in_others() -> None:
    base, same, cut = (response(x, 5.0, ends) for x, ends in (
        (0.0, (1.0, 2.0)), (0.1, (1.0, 2.0)), (0.001, (1.0, 1.5, 2.0)),
    ))  # fmt: skip
    back = response(-0.1, 5.0, (1.0, 2.0))
    wide = slope_through(base, ((0.1, same), (-0.1, back)), 1e-9)
    narrow = slope_through(base, ((0.001, cut), (-0.001, response(-0.001, 5.0, (1.0, 2.0)))), 1e-9)
    assert narrow.asymmetry < wide.asymmetry
    assert best_of([wide, narrow]).amounts == wide.amounts


RATES = np.linspace(1.0, 2.0, 40)
"""Exact derivatives of the numbers of a manufactured response, at the asked run."""


def manufactured(
    x: float,
    base: float = 0.0,
    scatter: float = 0.0,
    curvature: float = 0.0,
    kink: float = 0.0,
    jump: float = 0.0,
    seed: int = 0,
) -> Response:
    """Return a line of known slope with what makes differences of it wrong.

    Args:
        x: where along the direction.
        base: what the asked run alone is off by, in shares of the response.
        scatter: what each run is off by, its standard deviation in shares of the response.
        curvature: of the response, in shares of it, with a third derivative of the same size.
        kink: slope to the farther side less that to the nearer one, in shares of the slope.
        jump: what all runs to the farther side are off by, in shares of the response.
        seed: of the scatter.
    """
    rng = np.random.default_rng((seed, int(round(1e6 * abs(x))), int(x > 0)))
    pattern = np.cos(np.arange(RATES.size))
    values = 1 + RATES * x * (1 + kink * (x > 0)) + curvature * (x**2 / 2 + x**3 / 6) * pattern
    values += base * (x == 0) * pattern + jump * (x > 0) * pattern
    values += scatter * rng.normal(size=values.size)
    return Response(
        values.reshape(2, -1, 1), np.zeros(2), np.zeros((0, 2, 20, 1)), np.zeros((0, 2))
    )


def judged(scale: float, noise: float, **kinds: float) -> tuple[float, Slope]:
    """Return the actual error of the derivative that is chosen, in shares, and its judgement."""
    asked = manufactured(0.0, **kinds)  # type: ignore[arg-type]
    tried: list[Slope] = []
    step: float | None = (noise / 2) ** (1 / 3) * scale
    while step is not None and len(tried) < MOST_STEPS:
        pair = tuple((s, manufactured(s, **kinds)) for s in (step, -step))  # type: ignore[arg-type]
        tried.append(slope_through(asked, (pair[0], pair[1]), noise))
        step = following_step(tried, scale)
    best = best_of(tried)
    error = np.linalg.norm(best.displacement.ravel() - RATES) / np.linalg.norm(RATES)
    return float(error), best


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [0.01, 0.1, 1.0])
@pytest.mark.parametrize("curvature", [0.0, 1.0, 10.0])
@pytest.mark.parametrize(
    "kinds", [{}, {"base": 1e-5}, {"scatter": 1e-5}, {"base": 1e-5, "scatter": 3e-6}], ids=str
)
def test_a_derivative_that_is_called_certain_is_wrong_by_no_more_than_it_may(
    kinds: dict[str, float], curvature: float, scale: float, seed: int
) -> None:
    error, best = judged(scale, 1e-5, curvature=curvature, seed=seed, **kinds)
    # Independent noise makes 0.58 of the asymmetry on average, of which the half is told.
    assert error <= 1.5 * best.uncertainty + 1e-7
    if not best.doubtful:
        assert error <= 1.5 * ASYMMETRY / 2


def test_noise_that_leaves_no_step_certain_is_told_from_curvature_by_a_polynomial() -> None:
    """Of narrow steps noise makes the slopes wrong, of wide ones curvature seems to."""
    found = [judged(0.1, 1e-5, curvature=10.0, scatter=2e-4, seed=seed) for seed in range(16)]
    assert all(best.asymmetry > ASYMMETRY for _, best in found)
    certain = [error for error, best in found if not best.doubtful]
    assert len(certain) >= 15 and max(certain) <= ASYMMETRY / 2
    assert all(error <= 1.5 * best.uncertainty for error, best in found)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("curvature", [0.0, 1.0])
@pytest.mark.parametrize("scatter", [3e-6, 3e-5])
def test_a_kink_beside_noise_and_curvature_stays_doubtful(
    scatter: float, curvature: float, seed: int
) -> None:
    error, best = judged(0.1, 1e-5, curvature=curvature, scatter=scatter, kink=0.05, seed=seed)
    assert best.doubtful and error <= 2.3 * best.uncertainty


def test_what_the_asked_run_alone_is_off_by_makes_no_doubt_as_it_cancels() -> None:
    error, best = judged(0.1, 1e-5, base=1e-4, curvature=0.1)
    assert best.asymmetry > ASYMMETRY / 2
    assert not best.doubtful and error < 1e-6


@pytest.mark.parametrize("kink", [0.1, 1.0])
@pytest.mark.parametrize("base", [0.0, 1e-6])
def test_a_kink_is_called_doubtful_with_or_without_noise(kink: float, base: float) -> None:
    error, best = judged(1.0, 1e-5, kink=kink, base=base)
    # Its derivative is any between the two slopes; the mean is off by half of their difference.
    assert error == pytest.approx(kink / 2, rel=0.1)
    assert best.doubtful and 2 * best.uncertainty >= 0.9 * error / (1 + kink / 2)


@pytest.mark.parametrize("factor", [1.2, 1.6, 2.0, 4.0])
def test_a_jump_of_all_runs_to_one_side_is_all_of_the_asymmetry_twice_what_is_told(
    factor: float,
) -> None:
    asked = manufactured(0.0, jump=1e-3)
    tried = [
        slope_through(
            asked, ((s, manufactured(s, jump=1e-3)), (-s, manufactured(-s, jump=1e-3))), 1e-5
        )
        for s in (0.01, factor * 0.01)
    ]
    best = best_of(tried)
    error = np.linalg.norm(best.displacement.ravel() - RATES) / np.linalg.norm(RATES)
    assert best.amounts == tried[1].amounts
    assert error == pytest.approx(best.asymmetry, rel=0.05)
    assert best.uncertainty == best.asymmetry / 2


def test_a_cut_step_is_no_doubt_by_itself_but_all_of_the_asymmetry_may_be_its_error() -> None:
    ends = np.linspace(0.01, 1.0, 100)
    cut = np.sort(np.append(ends, 0.505))

    def taken(x: float, by: FloatArray, off: float) -> Response:
        found = manufactured(x, curvature=1.0)
        return replace(found, displacement=found.displacement + off, ends=by, steps=by.size)

    base, back = taken(0.0, ends, 0.0), taken(-0.01, ends, 0.0)
    for off in (1e-6, 1e-4, 1e-3):
        found = slope_through(base, ((0.01, taken(0.01, cut, off)), (-0.01, back)), 1e-5)
        exact = slope_through(base, ((0.01, taken(0.01, ends, off)), (-0.01, back)), 1e-5)
        assert found.same_steps and found.other_steps == pytest.approx(1 / 101)
        assert found.uncertainty == found.asymmetry == 2 * exact.uncertainty
        error = np.linalg.norm(found.displacement.ravel() - RATES) / np.linalg.norm(RATES)
        assert error <= 1.05 * found.uncertainty  # in shares of the derivative as it is found
        assert found.doubtful == (off == 1e-3)
    (doubt,) = found.doubts(DIRECTION)
    assert doubt.endswith("expected 1% or less")

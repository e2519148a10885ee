from __future__ import annotations

import numpy as np
import pytest

from driver.diagnosis.statistics.high_pass_loads import (
    LEFT,
    UNTOUCHED,
    HighPassLoads,
    freed,
    high_pass_loads,
)
from driver.identification.cosine_modes import cosine_modes, fast_modes
from driver.identification.objective import Evaluation
from meshes.arrays import FloatArray
from tests.driver.analytic import evaluation

T, N = 30, 90  # loads, and loads and images
RNG = np.random.default_rng(5)
# Slow in the loads but for the last: knots, which the model moves and unloads at once.
SLOW = cosine_modes(T, np.arange(4))
J = np.concatenate(
    [
        np.concatenate([8 * SLOW, RNG.standard_normal((4, N - T))], axis=1),
        np.concatenate([5 * np.eye(T)[[11]], 0.05 * RNG.standard_normal((1, N - T))], axis=1),
    ]
)


def fitted(data: FloatArray, rows: FloatArray = J) -> Evaluation:
    """What a fit leaves of whitened data."""
    theta = np.linalg.solve(rows @ rows.T, rows @ data)
    return evaluation(np.asarray(data - theta @ rows), rows, n_load=T)


def of_unit_data(left: float) -> FloatArray:
    """What each number of the data makes of y, shape (N, m)."""
    return np.array([high_pass_loads(fitted(one), left).residual for one in np.eye(N)])


@pytest.mark.parametrize("left", [UNTOUCHED, LEFT])
def test_noise_of_the_data_is_white_in_it(left: float) -> None:
    y = of_unit_data(left)
    assert y.T @ y == pytest.approx(np.eye(y.shape[1]), abs=1e-8)


def test_a_direction_that_the_fit_touches_is_left_out_where_noise_alone_is_wanted() -> None:
    fewer, all_but_taken = (of_unit_data(left).shape[1] for left in (UNTOUCHED, LEFT))
    assert fewer == all_but_taken - 1 == T // 2 - 1


def test_slow_errors_of_the_loads_do_not_enter() -> None:
    data = RNG.standard_normal(N)
    wrong = data.copy()
    wrong[:T] += 50 * cosine_modes(T, np.array([7]))[0]
    before, after = (high_pass_loads(fitted(d)).residual for d in (data, wrong))
    assert after == pytest.approx(before, abs=1e-8)


def test_a_change_of_the_data_is_a_known_direction() -> None:
    data, changes = RNG.standard_normal(N), RNG.standard_normal((3, N))
    found = high_pass_loads(fitted(data), LEFT)
    moved = [high_pass_loads(fitted(data + one), LEFT).residual - found.residual for one in changes]
    assert found.of(changes) == pytest.approx(np.array(moved), abs=1e-9)


def test_the_prior_counts_as_data_do() -> None:
    """A parameter held by a prior is one that was measured once more."""
    weight, off = 4.0, 0.7
    measured = np.zeros((len(J), 1))
    measured[-1] = np.sqrt(weight)
    data = np.append(RNG.standard_normal(N), np.sqrt(weight) * off)
    whole = fitted(data, np.concatenate([J, measured], axis=1))
    theta = np.linalg.lstsq(whole.jacobian.T, data - whole.residual, rcond=None)[0]
    held = evaluation(
        whole.residual[:-1], J, weight * np.eye(len(J))[-1], (off - theta) * np.eye(len(J))[-1],
        n_load=T,
    )  # fmt: skip
    expected, found = high_pass_loads(whole, LEFT), high_pass_loads(held, LEFT)
    assert found.residual == pytest.approx(expected.residual, abs=1e-9)


def seen(found: HighPassLoads, effect: FloatArray) -> float:
    """By how many σ an effect shows."""
    return float(np.linalg.norm(found.of(effect[None])))


def test_what_is_freed_shows_no_more_than_its_prior_lets_it() -> None:
    effect = np.zeros(N)
    effect[:T] = 3 * fast_modes(T)[2]
    at = fitted(RNG.standard_normal(N))
    before, after = high_pass_loads(at, 0.0), high_pass_loads(freed(at, effect[None]), 0.0)
    assert seen(before, effect) > 2.5
    # Of variance 1 + 100 · 3² in its direction nearly all is the freed amount.
    assert seen(after, effect) == pytest.approx(seen(before, effect) / np.sqrt(901), rel=0.05)

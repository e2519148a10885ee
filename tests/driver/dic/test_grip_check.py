from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.dic.grip_check import GripMotion, WithoutPenalty, grip_motion
from meshes.arrays import FloatArray

RATIO, NOMINAL, SIGMA = 2e-4, 12.0 / 32e3, 0.0026  # of the paper; a tenth of its noise [µm]
# Three cycles of 26, 6, 26, 6, 26 and 6 moves of 5 µm, an image after each.
STEPS = np.repeat([5.0, -5.0] * 3, [26, 6] * 3)
STAGE = np.concatenate([[0.0], np.cumsum(STEPS)])
PHASE = np.concatenate([[0], np.repeat(np.arange(6), [26, 6] * 3)])
ALL = np.ones(STAGE.size, dtype=bool)

NONE = WithoutPenalty(np.empty(0), np.inf, 0.0)  # regularisation that holds nothing back


def checked(
    change: Callable[[FloatArray], FloatArray] = lambda e: e,
    seed: int = 0,
    sigma: float = SIGMA,
    used: NDArray[np.bool_] = ALL,
    free: WithoutPenalty = NONE,
) -> GripMotion:
    noise = sigma * np.random.default_rng(seed).standard_normal(STAGE.size)
    return grip_motion(STAGE, change(RATIO * STAGE) + noise, sigma, PHASE, used, NOMINAL, free)


def is_silent(found: GripMotion) -> bool:
    return not (found.bowed or found.played or found.slips or found.outliers)


def test_the_ratio_has_the_scatter_that_its_sigma_says() -> None:
    found = [checked(seed=seed) for seed in range(300)]
    pulls = np.array([(f.ratio.value - RATIO) / f.ratio.sigma for f in found])
    # Mean and deviation of 300 unit normals: ± 0.06 and ± 0.04.
    assert abs(pulls.mean()) < 0.25 and pulls.std() == pytest.approx(1.0, abs=0.15)
    phases = np.array([[(p.ratio.value - RATIO) / p.ratio.sigma for p in f.phases] for f in found])
    lost = np.array([[t.lost.value / t.lost.sigma for t in f.turns] for f in found])
    bows = np.array([[p.bow.value / p.bow.sigma for p in f.phases if p.bow] for f in found])
    for many in (phases, lost, bows):
        assert many.std() == pytest.approx(1.0, abs=0.1)
    assert np.mean([f.scatter for f in found]) == pytest.approx(1.0, abs=0.02)


def test_sound_grips_are_found_sound() -> None:
    silent = [is_silent(checked(seed=seed)) for seed in range(300)]
    # Four families of tests at 1 % each.
    assert np.mean(silent) > 0.93


def test_phases_are_loading_and_unloading_in_turn() -> None:
    found = checked()
    assert [phase.loading for phase in found.phases] == [True, False] * 3
    assert (found.phases[1].first, found.phases[1].last) == (27, 32)
    assert [turn.image for turn in found.turns] == [26, 32, 58, 64, 90]
    up, down = found.ratio_of(True), found.ratio_of(False)
    assert up is not None and down is not None and up.sigma < down.sigma


def test_play_is_the_elongation_that_lags_after_a_turn() -> None:
    """A dead travel of 60 µm at the second turn, 12 nm: later phases are shifted."""

    def lagging(elongation: FloatArray) -> FloatArray:
        return np.asarray(elongation - 60.0 * RATIO * (PHASE >= 2))

    found = checked(lagging)
    assert [turn.image for turn in found.played] == [32]
    lost = found.played[0].lost
    assert abs(lost.value - 60.0 * RATIO) < 4 * lost.sigma
    # The same shift towards the new direction is no play: a grip slid.
    back = checked(lambda e: e + 60.0 * RATIO * (PHASE >= 2))
    assert back.played[0].lost.value < 0


def test_slip_is_a_break_within_a_phase() -> None:
    found = checked(lambda e: e - 0.015 * (np.arange(e.size) >= 45))
    assert [slip.image for slip in found.slips] == [45]
    (slip,) = found.slips
    assert abs(slip.jump.value + 0.015) < 4 * slip.jump.sigma


def test_a_bowed_phase_is_told_with_its_size() -> None:
    """A parabola of 10 nm over the second loading, as of play in a long thread."""
    middle = (STAGE - STAGE[32]) * (STAGE[58] - STAGE) / ((STAGE[58] - STAGE[32]) / 2) ** 2
    found = checked(lambda e: e + 0.010 * middle * (PHASE == 2))
    assert [phase.first for phase in found.bowed] == [33]
    bow = found.bowed[0].bow
    assert bow is not None
    # The phase has its images a step after the turn.
    assert bow.value == pytest.approx(0.010, abs=4 * bow.sigma + 0.001)


def test_an_image_that_lies_off_is_told_and_changes_no_ratio() -> None:
    off = checked(lambda e: e + 0.05 * (np.arange(e.size) == 40))
    assert off.outliers == (40,)
    without = checked(used=np.arange(STAGE.size) != 40)
    assert off.ratio.value == pytest.approx(without.ratio.value, rel=1e-12)


def test_an_image_that_is_left_out_already_is_not_looked_at() -> None:
    used = np.arange(STAGE.size) != 40
    found = checked(lambda e: e + 5.0 * ~used, used=used)
    assert not found.outliers and abs(found.ratio.value - RATIO) < 4 * found.ratio.sigma


def test_scatter_beyond_the_noise_widens_the_sigma() -> None:
    noise = 3 * SIGMA * np.random.default_rng(1).standard_normal(STAGE.size)
    found = grip_motion(STAGE, RATIO * STAGE + noise, SIGMA, PHASE, ALL, NOMINAL, NONE)
    sound = checked()
    assert found.scatter == pytest.approx(3.0, rel=0.25)
    assert found.ratio.sigma > 2.2 * sound.ratio.sigma


def test_two_images_are_enough_for_a_ratio() -> None:
    found = grip_motion(
        np.array([0.0, 10.0]), np.array([0.0, 0.002]), 0.026, np.zeros(2, dtype=np.int64),
        np.ones(2, dtype=bool), NOMINAL, NONE,
    )  # fmt: skip
    assert found.ratio.value == pytest.approx(2e-4)
    # A difference of two images over 10 µm.
    assert found.ratio.sigma == pytest.approx(0.026 * np.sqrt(2) / 10.0)
    assert found.phases[0].bow is None and not found.turns


def test_what_is_held_back_widens_every_ratio_by_the_same_share_and_bends_no_line() -> None:
    plain = checked()
    held = checked(free=WithoutPenalty(np.empty(0), np.inf, 0.002))
    # 2 nm of the root mean square of the elongation, of the same noise in both.
    noise = SIGMA * np.random.default_rng(0).standard_normal(STAGE.size)
    share = 0.002 / np.sqrt(np.mean((RATIO * STAGE + noise) ** 2))
    assert held.ratio.sigma == pytest.approx(np.hypot(plain.ratio.sigma, share * plain.ratio.value))
    for loading in (True, False):
        narrow, wide = plain.ratio_of(loading), held.ratio_of(loading)
        assert narrow is not None and wide is not None and wide.value == narrow.value
        assert wide.sigma == pytest.approx(np.hypot(narrow.sigma, share * narrow.value))
    assert (held.turns, held.phases, held.scatter) == (plain.turns, plain.phases, plain.scatter)


@pytest.mark.parametrize(("held", "better"), [(0.004, True), (0.0001, False)])
def test_the_ratio_is_that_without_penalty_where_that_is_known_better(
    held: float, better: bool
) -> None:
    """An elongation with twice the noise that is a tenth less, against one that is held back."""
    noise = 2 * SIGMA * np.random.default_rng(2).standard_normal(STAGE.size)
    free = WithoutPenalty(0.9 * RATIO * STAGE + noise, 2 * SIGMA, held)
    found = checked(free=free)
    assert found.unpenalised == better
    expected = np.polyfit(STAGE, free.elongation, 1)[0] if better else checked().ratio.value
    assert found.ratio.value == pytest.approx(expected, rel=1e-9)
    assert found.slips == checked().slips and found.turns == checked().turns

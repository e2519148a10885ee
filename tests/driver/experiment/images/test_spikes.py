from __future__ import annotations

import numpy as np

from driver.experiment.images.spikes import REACH, spikes, spread, strays

ROW, COL = np.indices((60, 130), dtype=float)
EVERYWHERE = np.ones(ROW.shape, bool)


def dots(seed: int) -> np.ndarray:
    """Platinum dots, 20 nm high and 7 pixels wide, on a step of 30 nm between two grains."""
    rng = np.random.default_rng(seed)
    height = np.where(COL > 70, 0.03, 0.0)
    for row, col in rng.uniform((0, 0), ROW.shape, (60, 2)):
        square = 1 - ((ROW - row) ** 2 + (COL - col) ** 2) / 3.6**2
        height = np.maximum(height, np.where(COL > 70, 0.03, 0.0) + 0.02 * np.sqrt(square.clip(0)))
    return height


def test_the_spread_is_the_standard_deviation_of_normal_numbers_whatever_a_few_do() -> None:
    values = np.random.default_rng(1).normal(size=100_000)
    assert abs(spread(values) - 1) < 0.015  # 0.37 %
    values[:2000] = 1e6
    assert abs(spread(values) - 1) < 0.05


def test_dust_is_found_and_nothing_else() -> None:
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        mean = dots(seed) + 0.009 / np.sqrt(10) * rng.normal(size=ROW.shape)
        assert not spikes(mean, EVERYWHERE).any()
        dust = np.zeros(ROW.shape, bool)
        dust[20:22, 40:43] = dust[45, 100] = True
        found = spikes(mean + 0.15 * dust, EVERYWHERE)
        assert found[dust].all()
        near = (np.abs(ROW - 20.5) <= 0.5 + REACH) & (np.abs(COL - 41) <= 1 + REACH)
        near |= (np.abs(ROW - 45) <= REACH) & (np.abs(COL - 100) <= REACH)
        assert not found[~near].any()


def test_a_pit_is_found_inside_the_region_alone() -> None:
    heights = 0.009 * np.random.default_rng(2).normal(size=ROW.shape)
    heights[10, 10] = heights[30, 30] = -0.3
    found = spikes(heights, ROW > 20)
    assert found[30, 30] and not found[:20].any()


def test_noise_below_a_digital_level_is_no_dust() -> None:
    levels = np.round(0.2 * np.random.default_rng(3).normal(size=ROW.shape))
    assert np.median(np.abs(levels)) == 0.0 and np.any(levels)
    assert not spikes(levels, EVERYWHERE).any()


def test_a_stray_of_one_repeat_is_found_and_nothing_else() -> None:
    rng = np.random.default_rng(4)
    stack = dots(0) + 0.009 * rng.normal(size=(10, *ROW.shape)) + 0.05 * rng.normal(size=(10, 1, 1))
    assert not strays(stack, EVERYWHERE).any()
    stack[3, 20, 30] += 0.2
    found = strays(stack, EVERYWHERE)
    assert found[20, 30] and found.sum() == 13  # the pixel and two around it

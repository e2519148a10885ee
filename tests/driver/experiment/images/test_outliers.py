from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.experiment.images.noise import Noise
from driver.experiment.images.outliers import (
    FEWEST,
    Outlier,
    find_outliers,
    frame_statistics,
    left_out,
    noise_levels,
    texts_by_frame,
)
from driver.experiment.images.reference import Reference

PIXEL = 0.11


def series(seed: int, T: int, scatter: float = 0.2) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Residual, noise and shift that grow with strain and scatter so that all would be named."""
    rng = np.random.default_rng(seed)
    growth = np.exp(np.linspace(0, 1, T))
    return (
        growth * np.exp(scatter * rng.normal(size=T)),
        0.009 * np.exp(scatter * rng.normal(size=T)),
        np.array([20 * PIXEL, 20 * PIXEL, 5.0]) * rng.normal(size=(T, 3)),
    )


@pytest.mark.parametrize("T", [FEWEST, 30, 97])
def test_a_series_without_outliers_names_none_at_the_stated_chance(T: int) -> None:
    """Five quantities at 1 % each: in 200 series at most 10 are expected, 20 is 3σ off."""
    named = sum(bool(find_outliers(*series(seed, T), PIXEL, "σ")) for seed in range(200))
    assert named <= 20


def test_the_outlier_of_thirty_frames_is_named_with_what_gives_it_away() -> None:
    for seed in range(50):
        residual, noise, shift = series(seed, 30, 0.01)
        shift[:, :2] /= 100
        residual[17] *= 1.5
        noise[8] *= 0.5
        shift[23, 1] += 9 * PIXEL
        shift[:, 2] *= 0.0
        found = find_outliers(residual, noise, shift, PIXEL, "σ")
        assert [(o.frame, o.what) for o in found] == [
            (8, "noise"), (17, "residual"), (23, "shift along Y"),
        ]  # fmt: skip
        assert found[1].found / found[1].usual == pytest.approx(1.5, rel=0.06)
        assert list(np.flatnonzero(left_out(found, 30))) == [17]


def test_a_lasting_step_a_good_frame_and_a_trifle_are_no_outliers() -> None:
    rng = np.random.default_rng(1)
    noise, shift = np.full(60, 0.009), np.zeros((60, 3))
    residual = np.where(np.arange(60) < 31, 1.0, 3.0) * np.exp(0.005 * rng.normal(size=60))
    residual[20] = 0.5
    residual[40] *= 1.08
    assert find_outliers(residual, noise, shift, PIXEL, "σ") == ()


def test_what_is_told_stands_once_for_each_frame() -> None:
    found = (Outlier(3, "residual", 2.0, 1.0, "σ"), Outlier(3, "noise", 18.0, 9.0, "nm"))
    assert texts_by_frame(found) == {
        3: "residual 2 σ where its neighbours have 1 σ, noise 18 nm where its neighbours have 9 nm"
    }


def test_noise_of_a_frame_is_measured_through_relief_and_not_outside_the_region() -> None:
    rng = np.random.default_rng(2)
    row, col = np.indices((80, 120), dtype=float)
    relief = 0.05 * np.sin(row / 4) * np.cos(col / 4)
    frames = relief + np.array([0.009, 0.02])[:, None, None] * rng.normal(size=(2, 80, 120))
    frames[:, 70:] += rng.normal(size=(2, 10, 120))
    # 8000 pixels, correlated over two: 2 %
    assert noise_levels(frames, row < 70) == pytest.approx([0.009, 0.02], rel=0.05)


def test_frames_are_told_apart_before_correlation() -> None:
    rng = np.random.default_rng(3)
    row, col = np.indices((60, 90), dtype=float)

    def surface(u: float, v: float) -> np.ndarray:
        wide = ndimage.gaussian_filter(np.random.default_rng(4).normal(size=(60, 90)), 3)
        moved = ndimage.shift(0.5 * wide, (u, v), order=3, mode="mirror")
        return np.asarray(moved)

    shifts = rng.uniform(-1, 1, (30, 2))
    frames = np.array([surface(u, v) for u, v in shifts])
    frames += rng.normal(scale=0.1, size=(30, 1, 1)) + 0.009 * rng.normal(size=frames.shape)
    frames[12, 20:40, 40:60] += 0.04
    codes = np.where((row > 8) & (row < 52) & (col > 8) & (col < 82), 0, 4).astype(np.uint8)
    reference = Reference(surface(0, 0), codes, Noise(0.009, 100), 10, np.zeros((10, 3)), False)
    found = frame_statistics(frames, reference, PIXEL)
    kept = np.arange(30) != 12
    # the bound of a shift from 9 nm of noise here is 0.01 px
    assert np.abs(found.shift[kept, :2] / PIXEL - shifts[kept]).max() < 0.05
    named = find_outliers(found.residual, found.noise, found.shift, PIXEL, "µm")
    assert {o.frame for o in named if o.what == "residual"} == {12}

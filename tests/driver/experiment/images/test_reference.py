from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.images.flatfield import FlatField
from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.reference import Reference, build_reference
from driver.experiment.images.region import Excluded

PIXEL, ORIGIN, BOUNDS = 0.11, (19.5, 5.0), (-1.5, 1.5, 0.0, 5.0)
ROW, COL = np.indices((40, 56), dtype=float)
SIGMA = 0.009


def surface(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    waves = np.sin(0.7 * row + 0.2 * col) + np.cos(0.6 * col - 0.1 * row)
    return np.asarray(0.5 + 0.03 * waves + 0.02 * np.sin(0.5 * (row - col)))


def repeats(n: int, seed: int, shifts: np.ndarray | None = None) -> np.ndarray:
    shifts = np.zeros((n, 2)) if shifts is None else shifts
    noise = SIGMA * np.random.default_rng(seed).normal(size=(n, *ROW.shape))
    return np.array([surface(ROW - u, COL - v) for u, v in shifts]) + noise


def built(stack: np.ndarray, mask_dust: bool = True) -> Reference:
    return build_reference(stack, None, PIXEL, ORIGIN, BOUNDS, mask_dust=mask_dust)


def test_the_mean_has_the_noise_of_n_repeats_that_stood_still() -> None:
    found = [built(repeats(8, seed)) for seed in range(40)]
    assert sum(reference.registered for reference in found) == 0  # 1e-3 each
    region = found[0].region
    errors = np.array([(r.heights - surface(ROW, COL))[region] for r in found])
    assert np.std(errors) == pytest.approx(SIGMA / np.sqrt(8), rel=0.02)  # 40 × 1300 numbers
    squares = np.array([r.noise.dof * (r.noise.sigma / SIGMA) ** 2 for r in found])
    dof = 7 * (region.sum() - 3)
    assert {r.noise.dof for r in found} == {dof}
    assert squares.mean() == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / 40))
    assert np.std(squares) == pytest.approx(np.sqrt(2 * dof), rel=0.4)  # 40 numbers: 11 %


def test_repeats_that_moved_are_found_and_brought_back() -> None:
    shifts = np.array([(0.0, 0.0), (0.8, -0.8), (-1.3, 1.3), (0.5, -0.5)])
    found = built(repeats(4, 3, shifts))
    assert found.registered
    # σ over the slopes of 1300 pixels: 0.01 px, twice for a difference of two images
    assert np.abs(found.shifts[:, :2] / PIXEL - shifts).max() < 0.06
    assert found.noise.sigma == pytest.approx(SIGMA, rel=0.05)
    assert found.noise.dof == 3 * (found.region.sum() - 5)
    assert np.std((found.heights - surface(ROW, COL))[found.region]) < 0.7 * SIGMA


def test_dust_is_left_out_and_may_be_kept() -> None:
    stack = repeats(10, 4)
    stack[:, 20, 30] += 0.4
    stack[6, 12, 14] -= 0.3
    found = built(stack)
    assert found.count(Excluded.DUST) == 2 * 13
    assert found.codes[20, 30] == found.codes[12, 14] == Excluded.DUST
    assert found.noise.sigma == pytest.approx(SIGMA, rel=0.02)
    kept = built(stack, mask_dust=False)
    assert kept.count(Excluded.DUST) == 0 and kept.region[20, 30]


def test_the_pattern_is_subtracted_and_a_trench_is_left_out() -> None:
    stack = repeats(4, 5)
    pattern = 0.02 * np.sin(0.3 * ROW)
    trenched = np.where(np.abs(ROW - 19.5) < 10, stack + pattern, np.nan)
    flat = FlatField(pattern, 0.0, np.zeros(ROW.shape), 400)
    found = build_reference(trenched, flat, PIXEL, ORIGIN, BOUNDS)
    plain = built(stack)
    rows = np.nonzero(found.region)[0]
    assert rows.min() == 12 and rows.max() == 27  # measured: rows 10 to 29
    assert found.heights[12:28] == pytest.approx(plain.heights[12:28], abs=1e-12)


def test_a_repeat_without_heights_is_named() -> None:
    stack = repeats(4, 6)
    stack[2, 19:21] = np.nan
    assert built(stack).region.any()
    stack[2] = np.nan
    with pytest.raises(ImageError, match="no pixel of the face"):
        built(stack)


def test_a_face_of_nothing_but_spikes_is_refused_with_the_key_that_keeps_it() -> None:
    quarter = np.pi / 2
    waves = 1e-3 * SIGMA * np.random.default_rng(1).normal(size=(3, *ROW.shape))
    waves += np.cos(quarter * ROW) * np.cos(quarter * COL)
    with pytest.raises(ImageError, match=r"^images\.dust: every pixel of the face"):
        built(waves)
    assert built(waves, mask_dust=False).region.any()

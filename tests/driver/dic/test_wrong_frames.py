from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from driver.dic.wrong_frames import exchanged, jumps, turned
from meshes.arrays import BoolArray, FloatArray

NOISE = 0.7  # of the relief


def maps(rows: int, columns: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """A face between symmetric trenches, the same moved by a few pixels, and where it is."""
    rng = np.random.default_rng(3)
    wide = ndimage.gaussian_filter(rng.normal(size=(rows + 8, columns + 8)), 1.5)
    wide /= wide.std()
    wall = rows // 5
    wide[: wall + 3] = wide[-wall - 3 :] = -40.0
    seen = wide[:rows, :columns], wide[3 : rows + 3, 5 : columns + 5]
    region = np.zeros((rows, columns), dtype=bool)
    region[wall + 6 : -wall - 6, 6:-6] = True
    first, moved = (heights + NOISE * rng.normal(size=heights.shape) for heights in seen)
    return first, moved, region


@pytest.mark.parametrize("size", [(120, 150), (160, 200)])
def test_a_mirrored_or_turned_frame_is_known_and_one_as_it_is_is_not(size: tuple[int, int]) -> None:
    reference, frame, region = maps(*size)
    assert turned(reference, frame, region) is None
    assert turned(reference, frame[::-1], region) == "mirrored along X"
    assert turned(reference, frame[:, ::-1], region) == "mirrored along Y"
    assert turned(reference, frame[::-1, ::-1], region) == "turned by 180°"


def test_another_surface_is_none_of_them() -> None:
    reference, _, region = maps(160, 200)
    rng = np.random.default_rng(4)
    other = ndimage.gaussian_filter(rng.normal(size=reference.shape), 1.5)
    assert turned(reference, other / other.std(), region) is None
    assert turned(reference, np.zeros_like(reference), region) is None


def elongation_of(travel: FloatArray, seed: int = 5) -> FloatArray:
    """Elongation of 1 nm of noise that bends and lags as the specimen yields."""
    noise = np.random.default_rng(seed).normal(0.0, 1e-3, travel.size)
    return np.asarray(4e-4 * travel + 1e-7 * travel**2 + noise)


CYCLE = 40.0 * np.concatenate([np.arange(20), np.arange(20, 10, -1), np.arange(10, 30)])
ALL = np.ones(CYCLE.size, dtype=bool)


@pytest.mark.parametrize("pair", [(8, 12), (10, 11), (6, 40), (22, 33)])
def test_two_frames_that_changed_places_are_named(pair: tuple[int, int]) -> None:
    elongation = elongation_of(CYCLE)
    elongation[list(pair)] = elongation[list(pair)[::-1]]
    assert exchanged(elongation, CYCLE, 1e-3, ALL) == [pair]


def test_series_in_order_name_no_pair_nor_does_one_frame_that_lies_off() -> None:
    for seed in range(200):
        assert exchanged(elongation_of(CYCLE, seed), CYCLE, 1e-3, ALL) == []
    elongation = elongation_of(CYCLE)
    elongation[15] += 0.05
    assert exchanged(elongation, CYCLE, 1e-3, ALL) == []
    elongation[30:] += 0.05  # slip
    assert exchanged(elongation, CYCLE, 1e-3, ALL) == []


def test_a_jump_that_lasts_is_named_once_and_frames_that_were_not_followed_do_not_count() -> None:
    shift = np.cumsum(np.random.default_rng(6).normal(0.0, 0.3, (40, 2)), axis=0)
    assert jumps(shift, np.ones(40, dtype=bool)) == []
    shift[17:, 1] += 40.0
    followed = np.ones(40, dtype=bool)
    ((frame, step),) = jumps(shift, followed)
    assert frame == 17 and step == pytest.approx([0.0, 40.0], abs=2.0)
    followed[17] = False
    assert [frame for frame, _ in jumps(shift, followed)] == [18]


def test_a_series_that_drifts_fast_has_no_jump() -> None:
    shift = np.outer(np.arange(30.0), [12.0, 0.0])
    assert jumps(shift, np.ones(30, dtype=bool)) == []

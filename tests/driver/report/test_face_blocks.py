import numpy as np
import pytest

from driver.report.face_blocks import FaceBlocks
from driver.report.maps import Face


def face() -> Face:
    rows, cols = np.meshgrid(np.arange(5, 12), np.arange(3, 13), indexing="ij")
    return Face(rows.ravel(), cols.ravel(), 0.1, (5.0, 2.0), np.zeros((0, 2, 2)))


def test_blocks_are_as_small_as_their_number_allows() -> None:
    assert FaceBlocks.of(face(), 70).side == 1
    blocks = FaceBlocks.of(face(), 69)
    assert (blocks.side, blocks.shape) == (2, (4, 5))


def test_the_mean_of_a_linear_field_is_its_value_in_the_middle_of_a_block() -> None:
    blocks, seen = FaceBlocks(face(), 2), face()
    x, y = (0.1 * (seen.rows - 5.0), 0.1 * (seen.cols - 2.0))
    mean = blocks.mean(2.0 * x - y)
    expected = 2.0 * blocks.x[:, None] - blocks.y
    assert mean[:3] == pytest.approx(expected[:3])  # of the last row there is one line of pixels


def test_a_pixel_without_a_value_does_not_count_and_a_block_without_any_has_none() -> None:
    values = np.ones(70)
    values[[0, 1, 10, 11]] = np.nan  # the first block
    values[2] = np.nan
    mean = FaceBlocks(face(), 2).mean(values)
    assert np.isnan(mean[0, 0]) and mean[0, 1] == 1.0


def test_independent_noise_keeps_its_deviation() -> None:
    rng = np.random.default_rng(1)
    blocks = FaceBlocks(face(), 2)
    found = np.stack([blocks.mean_over_noise(rng.standard_normal(70)) for _ in range(400)])
    assert found.std(axis=0) == pytest.approx(np.ones(blocks.shape), abs=0.15)

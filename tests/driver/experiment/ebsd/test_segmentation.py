"""Grains end where neighbours differ, on square and on hexagonal grids."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from driver.experiment.ebsd.maps import CUBIC, EbsdMap, Phase
from driver.experiment.ebsd.segmentation import THRESHOLD, grain_numbers
from driver.experiment.images.files import Refused
from meshes.arrays import FloatArray, IntArray
from tests.driver.ebsd_files import FIRST, grid, halves, hexagonal_grid


def ebsd_map(x: FloatArray, y: FloatArray, degrees: ArrayLike, phase: ArrayLike = 1) -> EbsdMap:
    angles = np.broadcast_to(degrees, (x.size, 3))
    return EbsdMap(
        x=x,
        y=y,
        rotations=Rotation.from_euler("ZXZ", angles, degrees=True).as_quat(scalar_first=True),
        phase=np.broadcast_to(phase, x.size).astype(np.int64),
        phases={1: Phase("iron", CUBIC), 2: Phase("nickel", CUBIC), 3: Phase("titanium", "6/mmm")},
    )


def sizes(numbers: IntArray) -> list[int]:
    return sorted(np.bincount(numbers[numbers >= 0]).tolist())


@pytest.mark.parametrize("make", [grid, hexagonal_grid])
def test_a_bicrystal_has_two_grains(make: object) -> None:
    x, y = grid(6, 8) if make is grid else hexagonal_grid(6, 8)
    numbers = grain_numbers(ebsd_map(x, y, halves(x, 1.6)))
    assert sizes(numbers) == sorted([np.sum(x < 1.6), np.sum(x >= 1.6)])
    assert np.unique(numbers[x < 1.6]).size == 1


def test_points_that_touch_at_a_corner_are_neighbours_on_a_hexagonal_grid_alone() -> None:
    # A line of one crystal one step down and half a step right at a time.
    x, y = hexagonal_grid(5, 6)
    line = np.abs(x - (1.0 + y / 3**0.5)) < 0.01
    angles = np.where(line[:, None], FIRST, np.array(FIRST) + [0.0, 20.0, 0.0])
    assert sizes(grain_numbers(ebsd_map(x, y, angles)))[0] == np.sum(line) == 5
    x, y = grid(5, 5)
    angles = np.where((x == y)[:, None], FIRST, np.array(FIRST) + [0.0, 20.0, 0.0])
    assert sizes(grain_numbers(ebsd_map(x, y, angles))) == [1, 1, 1, 1, 1, 10, 10]


def test_a_gradual_turn_is_one_grain_and_a_step_above_the_threshold_two() -> None:
    x, y = grid(3, 10)
    angles = np.array(FIRST) + np.outer(x / 0.5 * 0.9 * THRESHOLD, [1.0, 0.0, 0.0])
    assert sizes(grain_numbers(ebsd_map(x, y, angles))) == [30]
    step = np.array(FIRST) + np.outer(x > 2.2, [1.02 * THRESHOLD, 0.0, 0.0])
    assert sizes(grain_numbers(ebsd_map(x, y, step))) == [15, 15]


def test_equivalent_angles_are_one_grain() -> None:
    x, y = grid(4, 4)
    # Quarter turns of the crystal about its own z: φ2 + 90°.
    angles = np.array(FIRST) + np.outer(np.arange(16) % 4, [0.0, 0.0, 90.0])
    assert sizes(grain_numbers(ebsd_map(x, y, angles))) == [16]


def test_other_phases_and_points_that_were_not_indexed_part_grains() -> None:
    x, y = grid(3, 9)
    column = np.rint(x / 0.5).astype(int)
    phase = np.array([1, 1, 2, 2, -1, 1, 3, 1, 1])[column]
    numbers = grain_numbers(ebsd_map(x, y, FIRST, phase))
    assert sizes(numbers) == [3, 6, 6, 6]
    assert (numbers[phase == -1] == -1).all() and (numbers[phase == 3] == -1).all()


def test_points_on_no_grid_are_refused() -> None:
    x, y = grid(3, 3)
    points = ebsd_map(x, y, FIRST)
    for wrong in (
        replace(points, x=np.zeros(9)),
        replace(points, y=y + 0.2 * x),
        replace(points, x=x * 1e9, step=(0.5, 0.5)),
        replace(points, step=(1e-308, 0.5)),
    ):
        with pytest.raises(Refused) as error:
            grain_numbers(wrong)
        assert error.value.found.startswith("points that do not lie on a grid of")
        assert error.value.expected == "a map on a square or a hexagonal grid along x and y"


def test_a_single_row_and_a_single_point_are_maps() -> None:
    x, y = grid(1, 6)
    assert sizes(grain_numbers(ebsd_map(x, y, halves(x, 1.2)))) == [3, 3]
    assert sizes(grain_numbers(ebsd_map(x[:1], y[:1], FIRST))) == [1]

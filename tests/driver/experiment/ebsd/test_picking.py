"""A grain is picked by a point or by its number, and what could be picked is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from driver.experiment.ebsd.maps import EbsdMap
from driver.experiment.ebsd.picking import Pick, PickedGrain, picked_grain
from driver.experiment.ebsd.segmentation import grain_numbers
from driver.experiment.images.files import Refused
from tests.driver.ebsd_files import FIRST, SECOND, grid, halves
from tests.driver.experiment.ebsd.test_segmentation import ebsd_map

X, Y = grid(4, 6)
PHASE = np.where((X == 0.5) & (Y == 1.0), -1, np.where(X > 2.2, 3, 1))
POINTS = ebsd_map(X, Y, halves(X, 1.2), PHASE)


def picked(points: EbsdMap, pick: Pick) -> PickedGrain:
    return picked_grain(points, grain_numbers(points), pick)


def refused(points: EbsdMap, pick: Pick) -> tuple[str, str]:
    with pytest.raises(Refused) as error:
        picked(points, pick)
    return error.value.found, error.value.expected


def test_a_point_picks_the_grain_around_it() -> None:
    for place, angles, number in (((0.1, 0.1), FIRST, 11), ((1.7, 1.4), SECOND, 8)):
        grain = picked(POINTS, Pick(place))
        expected = Rotation.from_euler("ZXZ", angles, degrees=True).as_matrix()
        np.testing.assert_allclose(grain.rotation, expected, atol=1e-12)
        assert grain.points == number and grain.spread == pytest.approx(0, abs=1e-7)
        assert grain.surroundings == (23, 24)
    assert picked(POINTS, Pick((1.7, 1.4))).place == (1.5, 1.5)


def test_the_spread_is_the_rms_angle_from_the_mean() -> None:
    # Half of the points are turned by +2° about the loading axis, half by −2°.
    x, y = grid(4, 4)
    turns = np.where(np.arange(16) % 2, 2.0, -2.0)
    centre = Rotation.from_euler("ZXZ", FIRST, degrees=True)
    turned = Rotation.from_rotvec(np.outer(np.deg2rad(turns), [0, 1, 0])) * centre
    points = replace(ebsd_map(x, y, FIRST), rotations=turned.as_quat(scalar_first=True))
    grain = picked(points, Pick((0.0, 0.0)))
    np.testing.assert_allclose(grain.rotation, centre.as_matrix(), atol=1e-12)
    assert np.rad2deg(grain.spread) == pytest.approx(2.0)


def test_a_number_picks_the_grain_that_the_file_counts() -> None:
    points = replace(POINTS, grain_ids=np.where(X < 1.2, 7, 12))
    grain = picked(points, Pick(grain=7))
    expected = Rotation.from_euler("ZXZ", FIRST, degrees=True).as_matrix()
    np.testing.assert_allclose(grain.rotation, expected, atol=1e-12)
    assert grain.points == 11 and grain.place == (0.5, 0.5)
    assert refused(points, Pick(grain=8)) == (
        "ebsd_grain = 8, which no point has", "one of its grains, such as 7, 12",
    )  # fmt: skip
    titanium = replace(points, grain_ids=np.where(X > 2.2, 3, 7))
    assert refused(titanium, Pick(grain=3))[0] == "the phase “titanium” of Laue class 6/mmm there"


def test_grains_are_told_in_their_order_along_the_loading_axis() -> None:
    for along, first in (((1.0, 0.0), "[0.5, 0.5] (1.5"), ((-1.0, 0.0), "[1.5, 0.5] (1 ×")):
        expected = refused(POINTS, Pick(along=along))[1]
        assert expected.split("ebsd_to_specimen: ")[1].startswith(first)
    numbered = replace(POINTS, grain_ids=np.where(X < 1.2, 7, 12))
    assert "8 points, grain 12), [0.5" in refused(numbered, Pick(along=(-1.0, 0.0)))[1]


def test_a_number_without_numbers_in_the_file_is_refused() -> None:
    found, expected = refused(POINTS, Pick(grain=7))
    assert found == "ebsd_grain = 7, but no numbers of grains in it"
    assert expected.startswith("ebsd_point_um = [x, y] with x from 0 to 2.5")


@pytest.mark.parametrize(
    ("place", "found"),
    [
        (None, "no grain that is picked"),
        ((-3.0, 0.5), "ebsd_point_um = [-3, 0.5], where it has no point"),
        ((0.5, 1e4), "ebsd_point_um = [0.5, 10000], where it has no point"),
        ((0.6, 1.1), "ebsd_point_um = [0.6, 1.1], which was not indexed"),
    ],
)
def test_a_pick_that_meets_no_grain_is_told_what_could_be_picked(
    place: tuple[float, float] | None, found: str
) -> None:
    choice = (
        "ebsd_point_um = [x, y] with x from 0 to 2.5 and y from 0 to 1.5, such as in its largest "
        "grains, in their order along Y by orientation.ebsd_to_specimen: [0.5, 0.5] "
        "(1.5 × 2 µm, 11 points), [1.5, 0.5] (1 × 2 µm, 8 points)"
    )
    assert refused(POINTS, Pick(place)) == (found, choice)
    numbered = replace(POINTS, grain_ids=np.ones(24, dtype=np.int64))
    told = choice.replace("points)", "points, grain 1)")
    by_number = f"{told}, or ebsd_grain, a number of its own"
    assert refused(numbered, Pick(place)) == (found, by_number)


def test_a_crystal_that_is_not_cubic_is_refused() -> None:
    assert refused(POINTS, Pick((2.5, 0.0))) == (
        "the phase “titanium” of Laue class 6/mmm there",
        "a cubic crystal of class m-3m (432), which the law describes",
    )
    unknown = replace(POINTS, phases={})
    assert refused(unknown, Pick((0.0, 0.0)))[0] == "the phase “1” of no stated symmetry there"
    assert refused(unknown, Pick())[1] == "a map with a cubic phase of class m-3m"

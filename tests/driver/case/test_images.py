from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from driver.case.images import Dic, Images
from tests.driver.case.tables import refused

DIRECTION = {
    "+X": (1, 0, 0), "-X": (-1, 0, 0), "+Y": (0, 1, 0), "-Y": (0, -1, 0), "+Z": (0, 0, 1),
    "-Z": (0, 0, -1),
}  # fmt: skip
FACE = ("+X", "-X", "+Y", "-Y")


def test_of_all_arrangements_of_an_image_the_eight_right_handed_ones_are_accepted() -> None:
    accepted = 0
    for rows, columns, heights in product(FACE, FACE, ("+Z", "-Z")):
        lie = {"rows_along": rows, "columns_along": columns, "heights": heights}
        if round(np.linalg.det([DIRECTION[axis] for axis in lie.values()])) == 1:
            assert Images.model_validate(lie).rows_along == rows
            accepted += 1
        else:
            place, expected = refused(Images, **lie)
            assert place == "rows_along" and "mirrors the crystal" in expected
    assert accepted == 8


def test_lengths_of_images_are_micrometres_inside() -> None:
    images = Images(
        pixel_size_nm=110.0, height_per_level_nm=6.5, height_offset_nm=-250.0, noise_nm=9.0
    )
    inside = (images.pixel_um, images.level_um, images.offset_um, images.gamma_f)
    assert inside == pytest.approx((0.110, 0.0065, -0.25, 0.009))


def test_a_level_off_the_surface_is_a_number_or_none() -> None:
    assert Images(off_surface_level="none").off_surface_level == "none"
    assert Images(off_surface_level=255.0).off_surface_level == 255.0


def test_what_a_penalty_grants_is_estimated_without_end_or_so_many_pixels() -> None:
    assert Dic().roughness_um(0.11) == "estimated"
    assert Dic(roughness_px="none").roughness_um(0.11) == np.inf
    assert Dic(roughness_px=1.5).roughness_um(0.11) == pytest.approx(0.165)


@pytest.mark.parametrize(
    ("key", "value"), [("element_px", 0), ("travel_um", 0.0), ("penalty", "gap"), ("mesh", "")]
)
def test_a_correlation_that_cannot_be_is_refused(key: str, value: object) -> None:
    assert refused(Dic, **{key: value})[0] == key

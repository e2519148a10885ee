"""The causes of a specimen of more than two grains, each by its number."""

from __future__ import annotations

import pytest

from driver.diagnosis.causes.all_causes import EVERY, cause_of, every, names
from driver.diagnosis.causes.candidates import causes_of
from driver.diagnosis.causes.causes import LIBRARY
from driver.diagnosis.causes.grain_causes import library
from driver.parameters.registry import declared_parameters


def test_up_to_two_grains_the_library_is_what_it_was() -> None:
    assert library(1) is LIBRARY and library(2) is LIBRARY and every(2) == EVERY


@pytest.mark.parametrize("n_grains", [3, 4, 12])
def test_a_grain_more_has_five_causes_more_and_its_boundary_three(n_grains: int) -> None:
    found = library(n_grains)
    assert len(found) == len(LIBRARY) + 8 * (n_grains - 2)
    assert len({cause.name for cause in found}) == len({cause.title for cause in found})
    declared = declared_parameters(1, n_grains=n_grains)
    named = [name for cause in found for name in cause.parameters]
    # Length and gains are told with more knots; of the others each parameter has one cause.
    assert len(set(named)) == len(named) and set(named) <= set(declared)
    assert causes_of(tuple(declared), (), None, n_grains=n_grains) == found


def test_the_causes_of_three_grains_say_which_grain_or_boundary_is_meant() -> None:
    by_name = {cause.name: cause for cause in library(3)}
    contrast = by_name["grain3_contrast"]
    assert contrast.parameters == ("tau0_grain3",) and contrast.strongly_nonlinear
    assert contrast.sentence == ("grain 3 has another critical resolved shear stress than grain 1")
    turned = by_name["misorientation_grain3"]
    assert turned.parameters == tuple(f"rotation_grain3_{axis}" for axis in "xyz")
    assert turned.sentence == "grain 3 is oriented otherwise than its EBSD says"
    band = by_name["band_grain3"]
    assert band.parameters + band.companions == (
        "tau0_grain3_band", "tau0_grain3_band_middle", "tau0_grain3_band_half_width",
    )  # fmt: skip
    assert band.places == by_name["band_grain2"].places and band.title == "band in grain 3"
    varied = by_name["heterogeneity_grain3"]
    assert varied.sentence == "the critical resolved shear stress varies inside grain 3"
    tilt = by_name["boundary2_tilt"]
    assert tilt.parameters == ("boundary2_tilt_x", "boundary2_tilt_z")
    assert tilt.sentence == "grain boundary 2 is inclined otherwise"
    assert tilt.title == "tilt of grain boundary 2"
    assert not {"grain_contrast", "boundary_position"} & set(names(3))


@pytest.mark.parametrize("cause", every(4), ids=lambda cause: cause.name)
def test_a_cause_is_found_by_its_name_alone(cause: object) -> None:
    assert cause_of(cause.name) == cause  # type: ignore[attr-defined]


def test_a_name_of_the_users_own_is_no_cause_of_the_library() -> None:
    assert cause_of("grain3_is_soft") is None and cause_of("twisted_ends") is None

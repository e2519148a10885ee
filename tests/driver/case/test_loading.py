from __future__ import annotations

from typing import Any

import pytest

from driver.case.loading import Boundary, Loads
from tests.driver.case.tables import refused

RATIO: dict[str, Any] = {"stage_ratio": 4e-4, "stage_ratio_uncertainty": 1e-4}


def test_lengths_of_the_loading_are_micrometres_inside() -> None:
    assert Boundary(jitter_nm=0.5).jitter == pytest.approx(5e-4)
    assert Loads(noise_uN=6.0).gamma_F == 6.0


@pytest.mark.parametrize("absent", RATIO)
def test_a_motion_that_is_known_from_the_stage_needs_both_halves_of_its_ratio(absent: str) -> None:
    given: dict[str, Any] = {name: value for name, value in RATIO.items() if name != absent}
    assert Boundary(motion="stage", **RATIO).stage_ratio == 4e-4
    assert refused(Boundary, motion="stage", **given) == (
        absent, 'a number > 0 with motion = "stage"'
    )  # fmt: skip


@pytest.mark.parametrize("given", RATIO)
def test_a_motion_that_is_known_from_images_has_no_ratio_of_the_stage(given: str) -> None:
    assert refused(Boundary, **{given: RATIO[given]}) == (given, 'nothing with motion = "images"')


def test_a_clock_is_known_so_well_that_three_deviations_are_a_lag_that_can_be_fitted() -> None:
    assert Loads(clock_uncertainty_s=20.0).clock_uncertainty_s == 20.0
    assert refused(Loads, clock_uncertainty_s=20.1)[0] == "clock_uncertainty_s"


def test_noise_that_is_its_own_neighbour_for_ever_is_refused() -> None:
    assert Loads(autocorrelation=0.99).autocorrelation == 0.99
    assert refused(Loads, autocorrelation=1.0)[0] == "autocorrelation"


def test_a_load_is_left_out_once() -> None:
    assert Loads(left_out=(7, 3)).left_out == (7, 3)
    assert refused(Loads, left_out=(3, 7, 3)) == ("left_out", "each number once")

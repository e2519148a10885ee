"""The check of the grips is told in words with its numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from driver.dic.grip_check import Estimate, Slip
from driver.report.grip_texts import sentences
from tests.driver.dic.test_grip_check import PHASE, RATIO, checked


def test_the_ratio_stands_beside_that_of_the_grips() -> None:
    grip = replace(checked(), ratio=Estimate(2.03e-4, 0.05e-4))
    assert sentences(grip)[0] == (
        "The elongation of the specimen is (2.03 ± 0.05)·10⁻⁴ of the stage travel, 54 % of the "
        "3.75·10⁻⁴ that its length over the distance of the grips makes."
    )


def test_sound_grips_are_called_so() -> None:
    _, phases, verdict = sentences(checked())
    assert "in loading and" in phases and "in unloading" in phases
    assert verdict.startswith("Within the noise all phases are straight")


def test_each_finding_has_its_place_and_size() -> None:
    grip = checked(lambda e: e - 60.0 * RATIO * (PHASE >= 2) + 0.05 * (np.arange(e.size) == 40))
    grip = replace(grip, slips=(Slip(45, Estimate(-0.0152, 0.0013)),))
    play, slip, off = sentences(grip)[2:]
    # A dead travel of 60 µm, 12 nm, was put in.
    assert play == (
        "After the turn at image 32 it lags (play) by 9.5 ± 2.2 nm, 48 µm of stage travel."
    )
    assert slip == "At image 45 it jumps by −15.2 ± 1.3 nm and stays there (slip)."
    assert off == "Image 40 lies off."

"""Captions say in numbers what the pictures of free correlation show."""

from dataclasses import replace

import numpy as np
import pytest

from driver.report.measured import Curve
from driver.report.measured_figures import FIGURES
from driver.report.measured_texts import texts


def test_every_picture_has_a_caption_and_words_for_those_who_do_not_see_it(measured):
    found = texts(measured)
    assert tuple(found) == tuple(FIGURES)
    for text in found.values():
        assert text.caption.endswith(".") and text.alternative.endswith(".")
        # They stand in attributes of the page as they are.
        assert not set('<>&"') & set(text.alternative)


def test_the_band_and_the_elongation_are_written_in_nanometres(measured):
    peak = measured.elongation.value.copy()
    peak[8] = 0.0602
    text = texts(replace(measured, elongation=Curve(peak, 0.005)))["measure_travel"]
    assert "± 9.8 nm for the elongation, ± 2.0 nm for the tilt" in text.caption
    assert "the elongation is 60 ± 5 nm" in text.caption


def test_ranges_are_those_of_the_shown_images_and_noise_that_of_a_node(measured):
    text = texts(measured)["measure_fields"].caption
    v = 1e3 * measured.motion[measured.shown, :, 1]
    assert f"v from −{abs(v.min()):.1f} to {v.max():.1f} nm" in text
    assert "enlarged 20 times" in text
    assert "19 nm in u, 18 nm in v and 2.0 nm in w" in text


def test_far_residuals_are_counted_against_the_normal_distribution(measured):
    values = np.zeros_like(measured.standardised)
    values[0, : values.size // 100 + 1] = 3.5
    text = texts(replace(measured, standardised=values))["measure_noise"].caption
    assert f"all {values.size} residuals" in text
    assert "1.0 % lie beyond 3 σ (normal: 0.27 %), the farthest at 3.5 σ" in text


@pytest.mark.parametrize(("factor", "words"), [(20.0, "enlarged 10 times"), (500, "true to scale")])
def test_the_enlargement_is_stated(measured, factor, words):
    motion = measured.motion * factor / 10
    assert words in texts(replace(measured, motion=motion))["measure_fields"].caption

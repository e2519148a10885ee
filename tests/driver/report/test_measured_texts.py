"""Captions say in numbers what the pictures of free correlation show."""

from dataclasses import replace

import numpy as np
import pytest

from driver.report.measured import Curve, MeasuredMotion, Regularisation, Spread
from driver.report.measured_figures import FIGURES
from driver.report.measured_texts import texts


def test_every_picture_has_a_caption_and_words_for_those_who_do_not_see_it(
    measured: MeasuredMotion,
) -> None:
    found = texts(measured)
    assert [f"{name}.png" for name in found] == list(FIGURES)
    for text in found.values():
        assert text.caption.endswith(".") and text.alternative.endswith(".")
        # They stand in attributes of the page as they are.
        assert not set('<>&"') & set(text.alternative)


def test_the_band_and_the_elongation_are_written_in_nanometres(measured: MeasuredMotion) -> None:
    peak = measured.elongation.value.copy()
    peak[8] = 0.0602
    curve = Curve(peak, np.full(11, 0.005), 0.0, 0.005)
    text = texts(replace(measured, elongation=curve))["measure_travel"]
    assert "± 9.8 nm for the elongation, ± 2.0 nm for the tilt" in text.caption
    assert "the elongation is 60 ± 5 nm" in text.caption


def test_ranges_are_those_of_the_shown_images_and_noise_that_of_a_node(
    measured: MeasuredMotion,
) -> None:
    text = texts(measured)["measure_fields"].caption
    v = 1e3 * measured.motion[..., 1]
    assert f"v from −{abs(v.min()):.1f} to {v.max():.1f} nm" in text
    assert "enlarged 20 times" in text
    assert "19 nm in u, 18 nm in v and 2.0 nm in w" in text


def test_far_residuals_are_counted_against_the_normal_distribution(
    measured: MeasuredMotion,
) -> None:
    values = np.zeros_like(measured.standardised)
    values[0, : values.size // 100 + 1] = 3.5
    text = texts(replace(measured, spread=Spread.of(values)))["measure_noise"].caption
    assert f"all {values.size} residuals" in text
    assert "1.0 % lie beyond 3 σ (normal: 0.27 %), the farthest at 3.5 σ" in text


@pytest.mark.parametrize(("factor", "words"), [(20.0, "enlarged 10 times"), (500, "true to scale")])
def test_the_enlargement_is_stated(measured: MeasuredMotion, factor: float, words: str) -> None:
    motion = measured.motion * factor / 10
    assert words in texts(replace(measured, motion=motion))["measure_fields"].caption


def test_what_kept_the_motion_in_bounds_is_said_with_its_effect(measured: MeasuredMotion) -> None:
    text = texts(measured)["measure_travel"]
    said = "Tikhonov, its second derivatives, roughness 0.050 px, estimated from the images"
    assert said in text.caption
    assert "stage travel count as noise" not in text.caption
    stiff = Regularisation("elastic", 0.3, estimated=False, travel=12.0)
    curve = replace(measured.elongation, held=0.003, single=0.009)
    text = texts(replace(measured, regularisation=stiff, elongation=curve))["measure_travel"]
    assert "the elastic energy, roughness 0.30 px, as the case states" in text.caption
    assert "may hold back 3.0 nm" in text.caption
    assert "below 12 µm of stage travel count as noise" in text.caption
    assert "falls from 9.0 to 5.0 nm" in text.caption
    free = Regularisation("tikhonov", np.inf, estimated=False, travel=0.0)
    text = texts(replace(measured, regularisation=free))["measure_travel"]
    assert "The motion is not regularised." in text.caption


def test_images_that_did_not_converge_are_told_with_what_to_try(measured: MeasuredMotion) -> None:
    assert "all 11 images converged" in texts(measured)["measure_noise"].caption
    converged = np.arange(11) != 4
    stopped = tuple("diverged; try larger elements" if t == 4 else "" for t in range(11))
    text = texts(replace(measured, converged=converged, stopped=stopped))["measure_noise"].caption
    assert "1 of 11 images did not converge: image 4 diverged; try larger elements." in text


def test_pixels_that_an_image_lacks_are_not_counted(measured: MeasuredMotion) -> None:
    before = texts(measured)
    residual, values = measured.residual.copy(), measured.standardised.copy()
    residual[0, :100] = values[0, :100] = np.nan
    after = texts(replace(measured, residual=residual, spread=Spread.of(values)))
    assert f"all {values.size - 100} residuals" in after["measure_noise"].caption
    assert "nan" not in after["measure_noise"].caption + after["measure_residuals"].alternative
    assert before["measure_residuals"].caption == after["measure_residuals"].caption

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest

from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.causes.candidates import NotExamined
from driver.diagnosis.search.image_noise import examine_noise, unevenness
from driver.identification.fit import Fit
from driver.identification.image_data import reweighted
from driver.identification.objective import Objective
from meshes.arrays import FloatArray
from tools import closed_form
from tools.closed_form_diagnosis import diagnosis_of, identified

BENCH = closed_form.problem()
RECORD = closed_form.height_maps


def uneven(kind: str) -> FloatArray:
    """σ at each pixel over that of the quiet ones."""
    row, col = np.indices(closed_form.SHAPE, dtype=float)
    if kind == "defocus":
        return np.asarray(1.0 + 1.5 * ((col - 24) / 24) ** 2)
    x = (row - closed_form.ORIGIN[0]) * closed_form.PIXEL
    y = (col - closed_form.ORIGIN[1]) * closed_form.PIXEL
    h = 1e-5
    slope = np.hypot(
        closed_form.relief(x + h, y) - closed_form.relief(x - h, y),
        closed_form.relief(x, y + h) - closed_form.relief(x, y - h),
    ) / (2 * h)
    return np.asarray(1.0 + (slope / slope.std()) ** 2 / 5)


@cache
def baseline(
    kind: str, hidden: str = "", size: float = 0.0, seed: int = 0
) -> tuple[Objective, Fit]:
    def noisy(*args: Any) -> tuple[FloatArray, FloatArray]:
        frames, repeats = RECORD(*args)
        if kind == "even":
            return frames, repeats
        rng, more = np.random.default_rng(31 + seed), np.sqrt(uneven(kind) ** 2 - 1.0)
        return (
            frames + closed_form.SIGMA * more * rng.standard_normal(frames.shape),
            repeats + closed_form.SIGMA * more * rng.standard_normal(repeats.shape),
        )

    with patch.object(closed_form, "height_maps", noisy):
        made = closed_form.objective(BENCH, BENCH.truth | ({hidden: size} if hidden else {}), seed)
    return identified(BENCH, made)


@cache
def diagnosed(kind: str, hidden: str = "", size: float = 0.0) -> Diagnosis:
    return diagnosis_of(BENCH, baseline(kind, hidden, size))


@pytest.mark.parametrize("kind", ["steep", "defocus"])
def test_noise_that_differs_over_the_pixels_is_named_and_weighted(kind: str) -> None:
    found = diagnosed(kind)
    assert found.verdict.kind == "named" and found.verdict.names == ("noise_not_uniform",)
    ratio, sigma = found.levels["noise_ratio"]
    images = found.objective.data.image.images
    low, high = np.percentile(uneven(kind)[images.rows, images.cols], (5, 95))
    assert abs(ratio - high / low) < 0.25 * high / low and 0 < sigma < 0.3
    # Steep or far pixels count less now.
    plain = baseline(kind)[0].data.image
    weight = np.asarray(
        abs(found.objective.data.image.test).sum(axis=1) / abs(plain.test).sum(axis=1)
    )
    truth = uneven(kind)[images.rows, images.cols] ** -2.0
    assert np.corrcoef(weight.ravel(), truth)[0, 1] > 0.8


def test_even_noise_is_not_named() -> None:
    found = diagnosed("even")
    assert found.verdict.kind == "nothing wrong" and not found.levels
    (scored,) = (s for s in found.rounds[0].scores if s.cause.name == "noise_not_uniform")
    assert scored.p > 0.05 and 0 < scored.visible[0] < 1


def test_under_even_noise_p_is_no_smaller_than_it_should_be() -> None:
    objective, fitted = baseline("even")
    rng = np.random.default_rng(8)
    p = []
    for _ in range(100):
        drawn = replace(fitted.best, rho=rng.standard_normal(fitted.best.rho.shape))
        found = unevenness(drawn, objective.data, 1)
        assert found is not None
        p.append(found.score.p)
    assert np.mean(np.array(p) < 0.1) < 0.1 + 3 * np.sqrt(0.09 / 100)
    assert np.mean(np.array(p) < 0.5) > 0.5 - 3 * np.sqrt(0.25 / 100)


def test_a_model_error_is_not_taken_for_noise_and_both_come_out() -> None:
    alone = diagnosed("even", "tilt_drift", 2e-3)
    assert alone.verdict.names == ("tilt_drift",)
    both = diagnosed("steep", "tilt_drift", 2e-3)
    assert both.verdict.kind == "named"
    assert both.verdict.names == ("noise_not_uniform", "tilt_drift")


def test_weighted_numbers_of_uneven_noise_are_white() -> None:
    """Of noise alone, without a fit: unit variance and no correlation."""
    image = baseline("even")[0].data.image
    variance = 1.0 + 3.0 * np.random.default_rng(1).uniform(size=len(image.images.xy))
    variance /= variance.mean()
    weighed = reweighted(image, 7.0 * variance)
    covariance = (
        weighed.whiten
        @ (weighed.test.T @ (image.images.sigma**2 * variance[:, None] * weighed.test.toarray()))
        @ weighed.whiten.T
    )
    np.testing.assert_allclose(covariance, np.eye(weighed.n_z), atol=1e-8)
    rigid = np.einsum("rpc,pc->pr", weighed.rigid, weighed.slope)
    np.testing.assert_allclose(weighed.whiten @ (weighed.test.T @ rigid), 0.0, atol=1e-6)


def test_what_is_stated_is_not_looked_for() -> None:
    objective, fitted = baseline("steep")
    data = objective.data
    stated = replace(data, image=reweighted(data.image, np.ones(len(data.image.images.xy))))
    found = examine_noise(fitted.best, stated, None)
    assert isinstance(found, NotExamined) and "images.noise_map" in found.why
    assert examine_noise(fitted.best, data, ("load_gain",)) is None


def test_too_few_images_are_not_asked() -> None:
    objective, fitted = baseline("even")
    data = objective.data.frames(np.arange(20))
    few = replace(fitted.best, rho=fitted.best.rho[:20])
    assert unevenness(few, data, 1) is None

from __future__ import annotations

from dataclasses import replace
from functools import cache
from unittest.mock import patch

import numpy as np
from scipy import ndimage

from driver.diagnosis.answer.result_types import Diagnosis
from driver.forward.fixed_pattern import apparent_rise
from driver.identification.correction import Correction
from driver.identification.identify import Plan, identify
from driver.identification.objective import Objective
from driver.parameters.boundary import LAMBDAS
from meshes.arrays import FloatArray
from tools import closed_form
from tools.closed_form import LAW, SIZES
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, finer, identified

BENCH = closed_form.problem()
SHARE = 0.5
RECORD = closed_form.height_maps


def pattern() -> FloatArray:
    """Bumps of three pixels, 5 nm rms, and a bow of the field."""
    rough = np.random.default_rng(5).standard_normal(closed_form.SHAPE)
    bumps = ndimage.gaussian_filter(rough, 1.5)
    row, col = np.indices(closed_form.SHAPE)
    return np.asarray(0.005 * bumps / bumps.std() + 1e-5 * (row - 14) * (col - 24))


def heights(share: float) -> tuple[FloatArray, FloatArray]:
    frames, repeats = RECORD(BENCH, BENCH.truth, 0)
    return frames + share * pattern(), repeats + share * pattern()


def truly_moved() -> FloatArray:
    """Motion of the specimen and the stage at the pixels (T, n_pix, 3)."""
    motion = BENCH.model.predict(BENCH.truth).motion
    return np.asarray(motion + closed_form.stage_error(BENCH)[:, None])


def seen(share: float) -> Objective:
    """What is minimised where a share of the pattern is left, and flats show the pattern."""
    with patch.object(closed_form, "height_maps", lambda *_: heights(share)):
        made = closed_form.objective(BENCH, BENCH.truth)
    image = made.data.image
    images = replace(image.images, flat_pattern=pattern())
    return replace(made, data=replace(made.data, image=replace(image, images=images)))


@cache
def diagnosed(share: float) -> Diagnosis:
    objective, baseline = identified(BENCH, seen(share))
    objective, here = objective.with_pattern_at(baseline.best)
    problem = replace(BENCH, model=objective.model)
    return diagnosis_of(problem, (objective, replace(baseline, best=here)))


def test_a_pattern_does_nothing_where_nothing_moves_and_is_the_difference_of_places_else() -> None:
    images = replace(closed_form.surface_images(BENCH, BENCH.truth, 0), flat_pattern=pattern())
    motion = np.zeros((2, len(images.xy), 3))
    motion[1, :, 0], motion[1, :, 1] = 2 * closed_form.PIXEL, -closed_form.PIXEL
    rise = apparent_rise(images, motion)
    assert rise is not None
    np.testing.assert_allclose(rise[0], 0.0, atol=1e-12)
    inside = (images.rows < 22) & (images.cols > 6)
    shifted = pattern()[np.minimum(images.rows + 2, 27), images.cols - 1]
    expected = shifted - pattern()[images.rows, images.cols]
    np.testing.assert_allclose(rise[1, inside], expected[inside], atol=1e-12)


def test_the_prediction_follows_the_share_as_its_derivative_says() -> None:
    rise = np.random.default_rng(0).standard_normal(
        (BENCH.history.n_images, len(closed_form.pixels()))
    )
    model = replace(BENCH.model, pattern=rise)
    free = ("load_gain", "fixed_pattern")
    plain = model.predict(BENCH.truth, free)
    risen = model.predict(BENCH.truth | {"fixed_pattern": 0.3}, free)
    np.testing.assert_allclose(risen.motion - plain.motion, 0.3 * plain.carried[1], atol=1e-12)
    assert np.array_equal(plain.carried[1][..., 2], rise)
    assert not plain.d_surface[1].any() and not plain.d_load[1].any()
    assert np.array_equal(plain.motion, BENCH.model.predict(BENCH.truth).motion)


def test_the_pattern_is_read_where_the_fit_sees_the_specimen() -> None:
    objective, baseline = identified(BENCH, seen(SHARE))
    images = objective.data.image.images
    true = apparent_rise(images, truly_moved())
    # Somewhere else, as a noisy correlation has it: a tenth of a pixel off.
    noise = (
        0.1
        * closed_form.PIXEL
        * np.random.default_rng(8).standard_normal((len(truly_moved()), 1, 3))
    )
    model = replace(objective.model, pattern=apparent_rise(images, truly_moved() + noise))
    there, here = replace(objective, model=model).with_pattern_at(baseline.best)
    assert true is not None and model.pattern is not None and there.model.pattern is not None
    scale = np.std(true)
    assert np.std(model.pattern - true) > 0.2 * scale
    assert np.std(there.model.pattern - true) < 0.05 * scale
    # At the null of the pattern nothing else changes.
    np.testing.assert_allclose(here.residual, baseline.best.residual, atol=1e-9)
    np.testing.assert_allclose(here.jacobian, baseline.best.jacobian, atol=1e-9)


def test_identification_reads_a_pattern_that_is_free_where_its_fit_sees_the_specimen() -> None:
    objective, first = identified(BENCH, seen(SHARE))
    images, true = objective.data.image.images, truly_moved()
    rng = np.random.default_rng(8)
    noise = 0.1 * closed_form.PIXEL * rng.standard_normal((len(true), 1, 3))
    working = replace(BENCH.model, pattern=apparent_rise(images, true + noise))
    start = replace(objective, model=working, correction=Correction())
    knots = tuple(name for name in first.best.free if name not in (*LAMBDAS, *LAW))
    plan = Plan(law=(*LAW, "fixed_pattern"), knots=knots, sizes=SIZES, most=15)
    found = identify(working, finer(replace(BENCH, model=working)), start, first.values, plan)
    there, read = apparent_rise(images, true), found.objective.model.pattern
    assert there is not None and read is not None and working.pattern is not None
    assert np.std(read - there) < 0.25 * np.std(working.pattern - there)
    sigma = found.final.sigma("fixed_pattern", found.objective.parameters)
    assert abs(found.final.values["fixed_pattern"] - SHARE) < 3.5 * sigma < 0.3 * SHARE


def test_an_evaluation_follows_the_pattern_to_where_it_is_read() -> None:
    objective = seen(SHARE)
    values, free = BENCH.truth | {"fixed_pattern": 0.3}, ("tau0", "fixed_pattern")
    images = objective.data.image.images
    model = replace(objective.model, pattern=apparent_rise(images, 1.2 * truly_moved()))
    there, here = replace(objective, model=model).with_pattern_at(
        replace(objective, model=model).evaluate(values, free)
    )
    anew = there.evaluate(values, free)
    np.testing.assert_allclose(here.residual, anew.residual, atol=1e-9)
    np.testing.assert_allclose(here.jacobian, anew.jacobian, atol=1e-9)


def test_a_pattern_that_was_left_is_named_and_its_share_found() -> None:
    found = diagnosed(SHARE)
    assert found.verdict.kind == "named" and found.verdict.names == ("fixed_pattern",)
    sigma = found.extended.sigma("fixed_pattern", found.objective.parameters)
    assert abs(found.extended.values["fixed_pattern"] - SHARE) < 3.5 * sigma < 0.3 * SHARE
    assert found.extended.best.chi_image < found.baseline.best.chi_image


def test_a_pattern_that_was_removed_is_not_named() -> None:
    found = diagnosed(0.0)
    assert found.verdict.kind == "nothing wrong"
    (scored,) = (s for s in found.rounds[0].scores if s.cause.name == "fixed_pattern")
    assert scored.p > 0.05 and scored.visible[0] * 0.2 < SHARE


def test_without_flats_it_is_not_examined() -> None:
    baseline = identified(BENCH, closed_form.objective(BENCH, BENCH.truth))
    found = diagnosis_of(BENCH, baseline, replace(SETTINGS, wanted=("fixed_pattern",)))
    assert [(one.cause, one.why) for one in found.not_examined] == [
        ("fixed_pattern", "no flats show the pattern")
    ]

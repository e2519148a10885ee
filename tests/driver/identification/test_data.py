from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from driver.common.splines.images import spline_images
from driver.dic.basis import grid_basis
from driver.dic.surface_images import SurfaceImages
from driver.identification.correction import Correction
from driver.identification.data import Data
from driver.identification.identify import with_correction
from driver.identification.image_data import Gauge, build_image_data
from driver.identification.missing_pixels import lacking_pixels
from meshes.arrays import FloatArray
from tools import closed_form
from tools.closed_form import BOUNDS, ORIGIN, PIXEL, SHAPE

T = 6
SIGMA, N_REFERENCE, LOAD_NOISE, AUTOCORRELATION = 0.001, 4, 3.0, 0.6
BENCH = closed_form.problem()


def coordinates() -> tuple[FloatArray, FloatArray]:
    row, col = np.indices(SHAPE)
    return np.asarray((row - ORIGIN[0]) * PIXEL), np.asarray((col - ORIGIN[1]) * PIXEL)


STILL = closed_form.relief(*coordinates())
TEMPLATE = closed_form.surface_images(BENCH, BENCH.truth, 0)


def pictures(frames: FloatArray, reference: FloatArray) -> SurfaceImages:
    """A series with its noise level and the gradient of the relief itself."""
    return replace(
        TEMPLATE,
        reference=reference[TEMPLATE.rows, TEMPLATE.cols],
        frames=spline_images(frames, PIXEL, ORIGIN),
        sigma=SIGMA,
        n_reference=N_REFERENCE,
    )


def data(images: SurfaceImages, load: FloatArray, gauge: Gauge = "translation") -> Data:
    image = build_image_data(
        images,
        grid_basis(images.xy, BOUNDS, 12 * PIXEL),
        grid_basis(images.xy, BOUNDS, 8 * PIXEL),
        np.zeros((T, 3)),
        gauge,
        np.zeros((T, 1, 2)),
    )
    return Data(image, load, LOAD_NOISE, AUTOCORRELATION, np.arange(T))


def unmoved() -> FloatArray:
    return np.zeros((T, len(TEMPLATE.xy), 3))


def still(gauge: Gauge = "translation") -> Data:
    """Frames without noise or motion."""
    return data(pictures(np.repeat(STILL[None], T, axis=0), STILL), np.zeros(T), gauge)


def noise_draws(n: int) -> Iterator[Data]:
    """Nothing but noise: each frame its own, the reference a mean of four."""
    rng = np.random.default_rng(0)
    once = still()
    for _ in range(n):
        frames = STILL + SIGMA * rng.standard_normal((T, *SHAPE))
        reference = STILL + SIGMA * rng.standard_normal((N_REFERENCE, *SHAPE)).mean(axis=0)
        images = pictures(frames, reference)
        yield replace(once, image=replace(once.image, images=images))


@pytest.fixture(scope="module")
def whitened() -> FloatArray:
    """Image part of 300 whitened residuals, shape (300, T, n_z)."""
    found = []
    for draw in noise_draws(300):
        residual = draw.residual(unmoved(), np.zeros(T))[0]
        found.append(draw.image_part(residual))
    return np.array(found)


def test_image_noise_becomes_unit_noise(whitened: FloatArray) -> None:
    n = whitened[:, 0].size
    np.testing.assert_allclose(np.mean(whitened**2, axis=(0, 2)), 1.0, atol=4 * np.sqrt(2 / n))
    covariance = np.cov(whitened.reshape(-1, whitened.shape[2]).T)
    np.testing.assert_allclose(covariance, np.eye(len(covariance)), atol=5 / np.sqrt(300 * T))


def test_the_reference_they_share_does_not_correlate_whitened_frames(
    whitened: FloatArray,
) -> None:
    between = np.einsum("dtz,dsz->ts", whitened, whitened) / whitened[:, 0].size
    sampling = 4 / np.sqrt(whitened[:, 0].size)
    np.testing.assert_allclose(between - np.diag(np.diag(between)), 0.0, atol=sampling)
    # Before whitening in time, all frames share a quarter of the variance of one.
    raw = np.array([draw.image.residual(unmoved(), np.arange(T))[0] for draw in noise_draws(100)])
    shared = np.einsum("dtz,dsz->ts", raw, raw)[~np.eye(T, dtype=bool)].mean() / raw[:, 0].size
    assert shared == pytest.approx(1 / N_REFERENCE, abs=0.03)


def test_some_of_the_frames_are_whitened_by_themselves() -> None:
    index = np.array([1, 2, 5])
    parts = []
    for draw in noise_draws(150):
        some = draw.frames(index)
        assert some.n_load == 3
        parts.append(some.image_part(some.residual(unmoved(), np.zeros(T))[0]))
    z = np.array(parts)
    between = np.einsum("dtz,dsz->ts", z, z) / z[:, 0].size
    np.testing.assert_allclose(between, np.eye(3), atol=5 / np.sqrt(z[:, 0].size))


def test_an_image_that_is_left_out_has_no_say_but_its_load_has() -> None:
    (draw,) = noise_draws(1)
    spoilt = np.array(draw.image.images.frames.coefficients)
    spoilt[2] += 0.05 * np.random.default_rng(3).standard_normal(SHAPE)
    frames = replace(draw.image.images.frames, coefficients=spoilt)
    images = replace(draw.image.images, frames=frames)
    load = LOAD_NOISE * np.random.default_rng(4).standard_normal(T)
    own = replace(draw, image=replace(draw.image, images=images), load=load, left_out=(2,))
    residual, shift, rho = own.residual(unmoved(), np.zeros(T))
    others = own.frames(np.delete(np.arange(T), 2)).residual(unmoved(), np.zeros(T))[0]
    np.testing.assert_allclose(residual[T:], others[T - 1 :], atol=1e-12)
    whole = replace(own, left_out=()).residual(unmoved(), np.zeros(T))[0]
    np.testing.assert_allclose(residual[:T], whole[:T], atol=1e-12)
    assert len(shift) == len(rho) == T and own.n_load == T
    assert own.image_part(residual).shape == (T - 1, own.image.n_z)
    prediction = BENCH.model.predict(BENCH.truth, ("tau0",))
    assert own.frames(np.arange(T)).sensitivity(prediction).shape == (1, residual.size)


def test_a_load_that_is_left_out_has_no_say_whoever_leaves_it_out_but_its_image_has() -> None:
    whole, load = still(), np.zeros(T)
    less = replace(whole, stated_bad_loads=(2,), bad_loads=(4,))
    other = replace(less, load=np.where(np.isin(np.arange(T), (2, 4)), 1e3, load))
    assert less.n_load == T - 2 and less.frames(np.arange(4)).n_load == 3
    of_less, of_other = (d.residual(unmoved(), np.ones(T))[0] for d in (less, other))
    np.testing.assert_array_equal(of_less, of_other)
    np.testing.assert_array_equal(of_less[T - 2 :], whole.residual(unmoved(), np.ones(T))[0][T:])


def test_correlated_load_noise_becomes_unit_noise() -> None:
    rng = np.random.default_rng(1)
    once, loads = still().images_alone(), np.zeros((4000, T))
    loads[:, 0] = LOAD_NOISE * rng.standard_normal(4000)
    for t in range(1, T):
        own = LOAD_NOISE * np.sqrt(1 - AUTOCORRELATION**2) * rng.standard_normal(4000)
        loads[:, t] = AUTOCORRELATION * loads[:, t - 1] + own
    # The load part of a residual is linear in the loads: its matrix, from unit loads.
    units = [
        replace(once, load=unit, with_loads=True).residual(unmoved(), np.zeros(T))[0][:T]
        for unit in np.eye(T)
    ]
    np.testing.assert_allclose(np.cov((loads @ np.array(units)).T), np.eye(T), atol=0.08)


@pytest.mark.parametrize("gauge", ["translation", "rigid"])
def test_a_rigid_motion_leaves_the_residual_as_it_is(gauge: Gauge) -> None:
    (draw,) = noise_draws(1)
    own = still(gauge)
    own = replace(own, image=replace(own.image, images=draw.image.images))
    x, y = own.image.images.xy.T
    turned = np.zeros_like(unmoved())
    if gauge == "rigid":
        angle = 1e-3 * np.arange(T)[:, None]
        turned = np.stack([-angle * y, angle * x, angle * (x + y)], axis=-1)
    moved = turned + [0.05, -0.03, 0.2]
    before, shift_before, _ = own.residual(unmoved(), np.zeros(T))
    after, shift, _ = own.residual(moved, np.zeros(T))
    np.testing.assert_allclose(after, before, atol=2e-3)
    assert np.abs(shift - shift_before).max() > 0.1


def test_a_turn_is_seen_unless_the_gauge_takes_it() -> None:
    x, y = TEMPLATE.xy.T
    turned = np.broadcast_to(1e-3 * np.stack([-y, x, 0 * x], axis=-1), unmoved().shape)
    assert np.abs(still("translation").residual(turned, np.zeros(T))[0]).max() > 1
    assert np.abs(still("rigid").residual(turned, np.zeros(T))[0]).max() < 0.1


def holed() -> Data:
    """Frames without noise or motion, of which two lack a patch of the face."""
    own = still()
    frames = own.image.images.frames
    coefficients = np.array(frames.coefficients)
    coefficients[1:5:3, 12:19, 24:38] = np.nan
    images = replace(own.image.images, frames=replace(frames, coefficients=coefficients))
    lacking = lacking_pixels(images, unmoved())
    return replace(own, image=replace(own.image, images=images, lacking=lacking))


def test_frames_with_a_gap_lack_its_pixels_and_the_others_none() -> None:
    lacking = holed().image.lacking
    assert lacking is not None
    # The patch, and around it what a cubic spline reaches half a pixel away.
    assert set(lacking.sum(axis=1)) == {0, 11 * 18}
    assert np.flatnonzero(lacking.any(axis=1)).tolist() == [1, 4]
    assert lacking_pixels(still().image.images, unmoved()) is None


def test_the_misfit_does_not_jump_where_a_motion_carries_pixels_over_the_rim_of_a_gap() -> None:
    own = holed().images_alone()
    along = 0.4 * PIXEL * np.linspace(0, 1, 80)
    motions = [unmoved() + x * (own.image.images.xy[:, :1] > 0.5) * [1.0, 1, 0] for x in along]
    seen = np.array([own.residual(motion, np.zeros(T))[0] for motion in motions])
    steps = np.linalg.norm(np.diff(seen, axis=0), axis=1)
    assert steps.max() < 1.5 * np.median(steps)


@pytest.mark.parametrize("data_of", [still, holed])
@pytest.mark.parametrize("component", [0, 1, 2])
def test_the_sensitivity_is_the_change_of_the_residual(
    component: int, data_of: Callable[[], Data]
) -> None:
    """On images without noise, to the error of the spline's gradient."""
    own = data_of().images_alone()
    model = BENCH.model
    look = model.projection.at(model.projection.surface.points, BENCH.truth)
    X, Y = model.projection.surface.points.T
    field = np.zeros((T, X.size, 3))
    field[..., component] = np.arange(1, T + 1)[:, None] * (1 + X - 0.5 * Y + 0.3 * X * Y)
    at_pixels = np.einsum("pn,tnc->tpc", look.value.toarray(), field)
    step = 1e-5
    above, below = (own.residual(s * step * at_pixels, np.zeros(T))[0] for s in (1, -1))
    z = own.image.sensitivity(field[None], look.value, np.arange(T))
    of_pixels = own.image.pixel_sensitivity(at_pixels, np.arange(T))
    np.testing.assert_allclose(of_pixels, z[0], atol=1e-9)
    # (I + 11ᵀ/n)^(−1/2) over the frames, from its eigenvalues 1 and 1 + T/n.
    mean = z[0].mean(axis=0)
    whitened = (z[0] - mean + mean / np.sqrt(1 + T / N_REFERENCE)).ravel()
    difference = (above - below) / (2 * step)
    assert np.linalg.norm(difference + whitened) < 0.01 * np.linalg.norm(whitened)
    np.testing.assert_allclose(own.change(at_pixels, np.zeros(T)), whitened, atol=1e-9)


def test_a_change_of_the_loads_is_that_of_the_residual() -> None:
    (draw,) = noise_draws(1)
    change, still_there = np.linspace(1, 7, T) ** 2, np.zeros_like(unmoved())
    above, below = (draw.residual(unmoved(), s * change)[0] for s in (-1, 0))
    np.testing.assert_allclose(draw.change(still_there, change), above - below, atol=1e-9)


def test_the_jacobian_of_a_prediction_is_that_of_its_residual() -> None:
    """All kinds of parameters together, on noisy images of a deformed specimen."""
    objective = closed_form.objective(BENCH, BENCH.truth)
    free = ("tau0", "lambda_plus_Z", "elongation_3", "tilt_1", "load_gain", "tilt_drift",
            "origin_Y", "boundary_shift", "rotation_grain1_x")  # fmt: skip
    here = objective.evaluate(BENCH.truth, free)
    for name, row in zip(free, here.jacobian, strict=True):
        parameter, h = objective.parameters[name], 1e-3
        above, below = (
            objective.evaluate(
                BENCH.truth | {name: parameter.value(s, BENCH.truth[name])}, ()
            ).residual
            for s in (h, -h)
        )
        difference = (below - above) / (2 * h)
        # The gradient is that of the reference, the difference sees that of the noisy frame.
        assert np.linalg.norm(difference - row) < 0.15 * np.linalg.norm(row), name


def test_images_alone_are_the_image_part() -> None:
    (draw,) = noise_draws(1)
    draw = replace(draw, load=np.linspace(0, 50, T))
    whole, alone = draw.residual(unmoved(), np.zeros(T))[0], draw.images_alone()
    assert draw.n_load == T and alone.n_load == 0
    np.testing.assert_array_equal(alone.residual(unmoved(), np.zeros(T))[0], whole[T:])
    np.testing.assert_array_equal(alone.image_part(whole[T:]), draw.image_part(whole))


def test_a_noise_factor_divides_residual_and_sensitivity_alike() -> None:
    (draw,) = noise_draws(1)
    louder = replace(draw.image, noise_factor=2.0)
    z = draw.image.residual(unmoved(), np.arange(T))[0]
    np.testing.assert_allclose(2 * louder.residual(unmoved(), np.arange(T))[0], z)
    field = np.ones((len(TEMPLATE.xy), 3)) * TEMPLATE.xy[:, :1]
    np.testing.assert_allclose(
        2 * louder.pixel_sensitivity(field), draw.image.pixel_sensitivity(field)
    )


def test_the_noise_part_of_a_row_is_the_row_whitened_once_more() -> None:
    """R of (I + Σ)^(−1/2): what turns sensitivities without a simulation error into those with."""
    objective = closed_form.objective(BENCH, BENCH.truth)
    prediction = BENCH.model.predict(BENCH.truth, ("tau0", "elongation_1", "tilt_2"))
    rng = np.random.default_rng(9)
    change = Correction(
        1e-3 * rng.standard_normal(prediction.motion.shape),
        rng.standard_normal(prediction.load.shape),
    )
    plain = objective.data
    with_error = with_correction(objective, 1.0, change, closed_form.SIZES).data
    rows = plain.sensitivity(prediction)
    np.testing.assert_allclose(
        with_error.noise_part(rows), with_error.sensitivity(prediction), atol=1e-9
    )
    part, whole = (np.linalg.norm(r, axis=1) for r in (with_error.noise_part(rows), rows))
    assert np.all(part < whole)
    np.testing.assert_array_equal(plain.noise_part(rows), rows)


def test_an_expected_evaluation_needs_no_image() -> None:
    objective = closed_form.objective(BENCH, BENCH.truth)
    free = ("tau0", "elongation_1", "boundary_shift", "load_gain")
    made = objective.evaluate(BENCH.truth, free)
    images = objective.data.image.images
    image = replace(objective.data.image, images=images.only(np.arange(0)))
    empty = replace(objective, data=replace(objective.data, image=image))
    expected = empty.expect(made.prediction, BENCH.truth, free)
    np.testing.assert_array_equal(expected.jacobian, made.jacobian)
    assert expected.misfit == 0.0 and expected.n_load == made.n_load

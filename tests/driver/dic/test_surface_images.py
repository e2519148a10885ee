from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from driver.dic import surface_images
from driver.dic.surface_images import SurfaceImages, prepare, refine_gradient
from driver.experiment.images.flatfield import FlatField, flat_pattern
from driver.experiment.images.heightmaps import ImageError

PIXEL, ORIGIN, BOUNDS = 0.11, (19.5, 5.0), (-1.5, 1.5, 0.0, 5.0)
ROW, COL = np.indices((40, 56), dtype=float)
SIGMA = 0.009


def surface(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    return np.asarray(
        0.5
        + 0.03 * np.sin(0.7 * row + 0.2 * col)
        + 0.03 * np.cos(0.6 * col - 0.1 * row)
        + 0.02 * np.sin(0.5 * (row - col))
    )


def noisy(seed: int, n: int, row_shift: float = 0.0, col_shift: float = 0.0) -> np.ndarray:
    clean = surface(ROW - row_shift, COL - col_shift)
    return clean + SIGMA * np.random.default_rng(seed).normal(size=(n, *ROW.shape))


def constant_motion(images: SurfaceImages, u: float, v: float, w: float) -> np.ndarray:
    return np.tile([u, v, w], (images.n_frames, len(images.xy), 1))


def test_the_region_is_what_lies_in_bounds_and_mask() -> None:
    mask = COL != 20
    images = prepare(noisy(1, 1), noisy(2, 3), None, PIXEL, ORIGIN, BOUNDS, mask)
    x, y = images.xy.T
    assert x == pytest.approx((images.rows - 19.5) * PIXEL)
    assert y == pytest.approx((images.cols - 5.0) * PIXEL)
    assert x.min() == pytest.approx(-13.5 * PIXEL) and x.max() == pytest.approx(13.5 * PIXEL)
    assert y.min() == 0.0 and y.max() == pytest.approx(45 * PIXEL)
    assert len(x) == 28 * 45 and 20 not in images.cols


def test_noise_and_residual_agree_with_what_was_put_in() -> None:
    images = prepare(noisy(3, 6, 0.4, 0.3), noisy(4, 10), None, PIXEL, ORIGIN, BOUNDS)
    motion = constant_motion(images, 0.4 * PIXEL, 0.3 * PIXEL, 0.0)
    # 9 × 1300 degrees of freedom: 0.65 %
    assert images.sigma == pytest.approx(SIGMA, rel=0.02)
    assert images.residual(motion).shape == (6, len(images.xy))
    # 1288 pixels, weakly correlated by interpolation: 2–3 % a frame
    assert images.chi(motion) == pytest.approx(np.ones(6), abs=0.09)
    # in the gain, a whole-pixel shift differs from a fractional one
    whole = images.expected_residual_variance(0 * motion)
    assert whole == pytest.approx(np.full(whole.shape, images.sigma**2 * 1.1))
    assert np.all(images.expected_residual_variance(motion) < 0.75 * whole)


def test_a_frame_with_an_artefact_is_named_by_its_chi() -> None:
    frames = noisy(5, 5)
    frames[3, 20:24] += 0.04
    images = prepare(frames, noisy(6, 10), None, PIXEL, ORIGIN, BOUNDS)
    chi = images.chi(constant_motion(images, 0, 0, 0))
    assert int(chi.argmax()) == 3 and chi[3] > 1.5 and np.delete(chi, 3).max() < 1.1


def test_the_flat_pattern_is_taken_off_every_image() -> None:
    pattern = 0.02 * np.sin(0.3 * ROW)
    plain = prepare(noisy(7, 2), noisy(8, 4), None, PIXEL, ORIGIN, BOUNDS)
    flat = FlatField(pattern, 0.0, 0.0 * pattern, 400)
    patterned = prepare(noisy(7, 2) + pattern, noisy(8, 4) + pattern, flat, PIXEL, ORIGIN, BOUNDS)
    assert patterned.reference == pytest.approx(plain.reference, abs=1e-12)
    with_it, without = (np.array(images.frames.coefficients) for images in (patterned, plain))
    assert with_it == pytest.approx(without, abs=1e-10)


def test_a_trench_neither_rings_into_the_surface_nor_enters_the_region() -> None:
    def trenched(stack: np.ndarray, shift: float) -> np.ndarray:
        return np.where(np.abs(ROW - shift - 19.5) < 14, stack, np.nan)

    frames = trenched(noisy(9, 4, 0.6, -0.4), 0.6)
    images = prepare(frames, trenched(noisy(10, 10), 0.0), None, PIXEL, ORIGIN, BOUNDS)
    assert images.rows.min() == 8 and images.rows.max() == 31  # measured: rows 6 to 33
    motion = constant_motion(images, 0.6 * PIXEL, -0.4 * PIXEL, 0.0)
    edge = np.isin(images.rows, (8, 31))
    squares = images.residual(motion) ** 2 / images.expected_residual_variance(motion)
    assert squares[:, edge].mean() == pytest.approx(1.0, abs=0.25)  # 4 × 92 values


def test_heights_that_a_frame_lacks_do_not_show_in_its_residual() -> None:
    frames = noisy(15, 4)
    lost = np.random.default_rng(16).random(frames.shape) < 0.002
    frames[lost] = np.nan
    images = prepare(frames, noisy(17, 10), None, PIXEL, ORIGIN, BOUNDS)
    assert len(images.xy) == 28 * 46
    # 1288 pixels: 2 %; a filled pixel is off by the slope, 25 nm/px, with a spline's ringing
    assert images.chi(constant_motion(images, 0, 0, 0)) == pytest.approx(np.ones(4), abs=0.08)


def test_repeats_that_moved_are_registered_and_the_noise_is_not_inflated() -> None:
    shifts = [0.0, 0.8, -1.3, 0.5]
    repeats = np.concatenate([noisy(20 + k, 1, s, -s) for k, s in enumerate(shifts)])
    images = prepare(noisy(30, 1), repeats, None, PIXEL, ORIGIN, BOUNDS)
    assert images.sigma == pytest.approx(SIGMA, rel=0.05)
    truth = surface(images.rows.astype(float), images.cols.astype(float))
    assert np.std(images.reference - truth) < 0.7 * SIGMA


def test_the_refined_gradient_has_less_error_than_the_first() -> None:
    images = prepare(noisy(11, 40, 0.4, 0.3), noisy(12, 10), None, PIXEL, ORIGIN, BOUNDS)
    refined = refine_gradient(images, constant_motion(images, 0.4 * PIXEL, 0.3 * PIXEL, 0.0))
    row, col = images.rows.astype(float), images.cols.astype(float)
    step = 1e-4
    truth = np.column_stack(
        [
            surface(row + step, col) - surface(row - step, col),
            surface(row, col + step) - surface(row, col - step),
        ]
    ) / (2 * step * PIXEL)

    def error(candidate: SurfaceImages) -> float:
        return float(np.sqrt(np.mean((candidate.gradient - truth) ** 2)))

    # spline slope of white noise: 0.96 σ/px, of 10 + 40 images, those between pixels smoother
    assert error(refined) < 0.96 * SIGMA / PIXEL / np.sqrt(50) * 1.15
    assert error(refined) < 0.5 * error(images)
    assert np.array_equal(refined.reference, images.reference)


def test_the_noise_of_few_flats_hardly_draws_the_motion_to_none() -> None:
    """It stands still in all images: a gradient that held it would see it do so."""
    u, v, noise = 0.4 * PIXEL, 0.3 * PIXEL, 0.02
    still = 1e-5 * np.random.default_rng(5).standard_normal((3, *ROW.shape))

    def short(images: SurfaceImages, motion: np.ndarray) -> np.ndarray:
        """Share of u and v that a linear correlation from the true motion takes back."""
        gradient = refine_gradient(images, motion).gradient
        slope = np.column_stack([gradient, -np.ones(len(images.xy))])
        rho = images.residual(motion)[0]
        return np.asarray(np.linalg.solve(slope.T @ slope, slope.T @ rho)[:2] / [u, v])

    found, held = [], []
    for seed in range(20):
        rng = np.random.default_rng([7, seed])
        flat = flat_pattern(noise * rng.standard_normal((4, *ROW.shape)))
        frames = surface(ROW - 0.4, COL - 0.3)[None]
        images = prepare(frames, surface(ROW, COL) + still, flat, PIXEL, ORIGIN, BOUNDS)
        motion = constant_motion(images, u, v, 0.0)
        found.append(short(images, motion))
        held.append(short(replace(images, flat_noise=np.zeros(ROW.shape)), motion))
    assert np.all(np.abs(np.mean(held, axis=0)) > 0.2)
    assert np.all(np.abs(np.mean(found, axis=0)) < 0.04)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a | {"frames": a["frames"][:, 1:]}, "frames of"),
        (
            lambda a: a | {"flat": FlatField(np.zeros((3, 3)), 0.0, np.zeros((3, 3)), 9)},
            "flat pattern of",
        ),
        (lambda a: a | {"mask": np.ones((3, 3), bool)}, "mask of"),
        (lambda a: a | {"bounds": (90.0, 91.0, 0.0, 5.0)}, "no pixel of the face"),
        (lambda a: a | {"frames": np.nan * a["frames"]}, "frame 0: no pixel carries a height"),
    ],
)
def test_input_that_does_not_fit_is_named(
    change: Callable[[dict[str, Any]], dict[str, Any]], message: str
) -> None:
    arguments = {
        "frames": noisy(13, 2), "repeats": noisy(14, 3), "flat": None, "pixel": PIXEL,
        "origin": ORIGIN, "bounds": BOUNDS,
    }  # fmt: skip
    with pytest.raises(ImageError, match=message):
        prepare(**change(arguments))


def test_splines_that_are_made_anew_and_blocks_of_frames_change_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    frames, repeats = noisy(40, 7, 0.4, 0.3), noisy(41, 10)
    frames[3, 20:24, 30:34] = np.nan
    kept = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    motion = constant_motion(kept, 0.4 * PIXEL, 0.3 * PIXEL, 0.0)
    motion = np.repeat(motion[:1], 7, axis=0)
    monkeypatch.setattr("driver.dic.surface_images._KEPT", 0)
    monkeypatch.setattr("driver.dic.surface_images._BLOCK", 2 * frames[0].size)
    anew = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    assert isinstance(kept.frames.coefficients, np.ndarray)
    assert not isinstance(anew.frames.coefficients, np.ndarray)
    assert [index.tolist() for index, _ in anew.blocks()] == [[0, 1], [2, 3], [4, 5], [6]]
    np.testing.assert_array_equal(anew.residual(motion), kept.residual(motion))
    np.testing.assert_array_equal(anew.chi(motion), kept.chi(motion))
    refined = refine_gradient(anew, motion).gradient
    np.testing.assert_array_equal(refined, refine_gradient(kept, motion).gradient)
    np.testing.assert_array_equal(anew.kept().frames.coefficients, kept.frames.coefficients)


@pytest.mark.parametrize("kept", [True, False])
def test_frames_are_brought_to_the_height_of_the_reference_and_others_stay_as_they_are(
    kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not kept:
        monkeypatch.setattr(surface_images, "_KEPT", 0)
    frames = noisy(30, 3)
    low = frames.copy()
    images = prepare(frames, noisy(31, 4), None, PIXEL, ORIGIN, BOUNDS)
    level = frames[1][images.rows, images.cols].mean()
    low[1] = level + 0.9 * (frames[1] - level)
    shown = prepare(low, noisy(31, 4), None, PIXEL, ORIGIN, BOUNDS)
    assert shown.rescaled(np.ones(3)) is shown
    rescaled = shown.rescaled(np.array([1.0, 0.9, 1.0])).frames.coefficients
    for t in (0, 2):
        np.testing.assert_array_equal(rescaled[t], shown.frames.coefficients[t])
    # The mean of the coefficients on the face is that of its heights but for its rim.
    difference = rescaled[1] - images.frames.coefficients[1]
    assert np.ptp(difference) < 1e-12 and abs(difference.mean()) < 0.01 * np.std(frames[1])

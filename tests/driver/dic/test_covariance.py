"""Stated covariances against the scatter of elongations over draws of noise and flat pattern."""

from __future__ import annotations

import numpy as np
import pytest

from driver.dic.covariance import covariance_in_time, held_back
from driver.dic.elongation import edge_motion
from driver.dic.series import SurfaceMotion, measure
from driver.dic.surface_images import SurfaceImages, prepare
from driver.experiment.images.flatfield import FlatField, flat_pattern
from meshes.arrays import FloatArray
from tests.driver.dic.conftest import BOUNDS, ORIGIN, PIXEL, SHAPE, deformed, zero

DRAWS = 60
STRETCH = (0.0, 0.004, 0.012)


def stretched(by: float, shift: float) -> FloatArray:
    """An image whose stage is off by a part of a pixel."""
    return deformed(
        lambda x, y: 0 * x + shift, lambda x, y: by * (y - 3.5) - 0.5 * shift + 0 * x, zero
    )


SHIFT = (0.0, 0.1 * PIXEL, -0.4 * PIXEL)
CLEAN = np.array([stretched(by, s) for by, s in zip(STRETCH, SHIFT, strict=True)])
STILL = deformed(zero, zero, zero)


def elongation(images: SurfaceImages) -> tuple[FloatArray, SurfaceMotion, FloatArray]:
    motion = measure(images)
    edges = edge_motion(motion, images, *BOUNDS[2:])
    return edges.elongation, motion, edges.difference(1)


def test_the_error_of_the_flat_pattern_has_the_stated_covariance_over_the_images() -> None:
    noise, n_flats = 0.004, 4
    rng = np.random.default_rng(1)
    # Repeats that differ by a hair: all scatter is that of the pattern.
    hair = 1e-6 * rng.normal(size=(3, *SHAPE))
    found = []
    for _ in range(DRAWS):
        flat = flat_pattern(noise * rng.normal(size=(n_flats, *SHAPE)))
        images = prepare(CLEAN, STILL + hair, flat, PIXEL, ORIGIN, BOUNDS)
        values, motion, functional = elongation(images)
        found.append(values)
    stated = covariance_in_time(motion, images, functional[None])[0]
    scatter = np.cov(np.array(found).T)
    # Without motion nothing is left of it; the more, the farther the surface moved.
    assert scatter[0, 0] < 1e-3 * scatter[2, 2]
    assert stated[0, 0] < 1e-3 * stated[2, 2]
    # 59 degrees of freedom: 18 % of a variance; the flats know their own error to less than that
    assert np.diag(scatter)[1:] / np.diag(stated)[1:] == pytest.approx(np.ones(2), abs=0.55)
    moving = np.s_[1:, 1:]
    root = np.sqrt(np.diag(stated)[1:])
    assert scatter[moving] / np.outer(root, root) == pytest.approx(
        stated[moving] / np.outer(root, root), abs=0.5
    )


def test_a_frame_with_a_hole_has_the_larger_stated_scatter() -> None:
    sigma, rng = 0.009, np.random.default_rng(2)
    clean = np.repeat(CLEAN[1:2], 2 * DRAWS, axis=0)
    frames = clean + sigma * rng.normal(size=clean.shape)
    frames[DRAWS:, 8:40, 60:72] = np.nan
    repeats = STILL + sigma * rng.normal(size=(10, *SHAPE))
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    values, motion, functional = elongation(images)
    stated = covariance_in_time(motion, images, functional[None])[0]
    for part in (slice(0, DRAWS), slice(DRAWS, None)):
        own = stated[part, part][0, 0] - stated[part, part][0, 1]
        assert values[part].var(ddof=1) == pytest.approx(own, rel=3 * np.sqrt(2 / (DRAWS - 1)))
    assert stated[-1, -1] > 1.2 * stated[0, 0]
    # What the frames share is the noise of the reference, which no interpolation smoothes.
    own = stated[0, 0] - stated[0, 1]
    assert 0.9 * stated[0, 1] < own / 10 < stated[0, 1]


def test_a_frame_with_all_pixels_has_the_covariance_of_its_nodal_values() -> None:
    rng = np.random.default_rng(6)
    repeats = STILL + 0.009 * rng.normal(size=(10, *SHAPE))
    frames = CLEAN + 0.009 * rng.normal(size=CLEAN.shape)
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    _, motion, functional = elongation(images)
    several = np.array([functional, rng.normal(size=functional.size)])
    stated = covariance_in_time(motion, images, several)
    one = several @ motion.covariance_one @ several.T
    for k in range(2):
        expected = np.full(len(frames), one[k, k] * (1 + 1 / 10))
        assert np.diag(stated[k]) == pytest.approx(expected, rel=1e-9)


def test_the_bands_in_which_the_flat_pattern_is_taken_change_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(9)
    frames = CLEAN + 0.009 * rng.normal(size=CLEAN.shape)
    frames[1, 20:24, 30:34] = np.nan
    repeats = STILL + 0.009 * rng.normal(size=(10, *SHAPE))
    flat = FlatField(np.zeros(SHAPE), 0.003, rng.uniform(0.001, 0.005, SHAPE), 4)
    images = prepare(frames, repeats, flat, PIXEL, ORIGIN, BOUNDS)
    _, motion, functional = elongation(images)
    assert not motion.compared[1].all()
    whole = covariance_in_time(motion, images, functional[None])
    monkeypatch.setattr("driver.dic.covariance._BLOCK", 1000)
    monkeypatch.setattr("driver.dic.covariance._PIXELS", 100)
    np.testing.assert_allclose(
        covariance_in_time(motion, images, functional[None]),
        whole,
        rtol=0,
        atol=1e-12 * whole.max(),
    )


def test_a_lost_frame_is_stated_as_one_without_gaps_and_spoils_no_other() -> None:
    rng = np.random.default_rng(8)
    noise = 0.009 * rng.normal(size=CLEAN.shape)
    repeats = STILL + 0.009 * rng.normal(size=(10, *SHAPE))
    flat = FlatField(np.zeros(SHAPE), 0.001, np.full(SHAPE, 0.001), 4)
    frames = CLEAN + noise
    frames[1, :, 20:] = np.nan
    images = prepare(frames, repeats, flat, PIXEL, ORIGIN, BOUNDS)
    _, motion, functional = elongation(images)
    assert motion.lost.tolist() == [False, True, False]
    # Wherever its iteration went.
    motion.coefficients[1] += 1e6
    stated = covariance_in_time(motion, images, functional[None])[0]
    one = functional @ motion.covariance_one @ functional
    assert stated[1, 1] == pytest.approx(one * (1 + 1 / 10), rel=1e-9)
    assert np.linalg.eigvalsh(stated).min() > 0


def test_what_the_penalty_holds_back_is_the_bias_of_motions_as_rough_as_it_grants() -> None:
    images = prepare(
        CLEAN[:1], STILL + 0.009 * np.random.default_rng(3).normal(size=(10, *SHAPE)), None,
        PIXEL, ORIGIN, BOUNDS,
    )  # fmt: skip
    motion = measure(images, roughness=0.05 * PIXEL)
    functional = edge_motion(motion, images, *BOUNDS[2:]).difference(1)
    system = motion.system
    (weight, _), part = system.weights, np.asarray(system.parts[0])
    variance = images.sigma**2 * (1 + 1 / images.n_reference)
    values, vectors = np.linalg.eigh(weight * part / variance)
    rough = values > 1e-9 * values[-1]
    rng = np.random.default_rng(4)
    drawn = rng.normal(size=(rough.sum(), 4000)) / np.sqrt(values[rough])[:, None]
    draws = vectors[:, rough] @ drawn
    bias = functional @ system.solve(weight * (part @ draws))
    # 4000 draws: 1.1 % of a standard deviation
    assert bias.std() == pytest.approx(held_back(motion, images, functional), rel=0.05)
    free = measure(images, roughness=np.inf)
    assert held_back(free, images, functional) == 0.0


def test_a_flat_without_error_adds_nothing() -> None:
    repeats = STILL + 0.009 * np.random.default_rng(5).normal(size=(4, *SHAPE))
    pattern = FlatField(np.zeros(SHAPE), 0.0, np.zeros(SHAPE), 400)
    covariances = []
    for flat in (None, pattern):
        images = prepare(CLEAN, repeats, flat, PIXEL, ORIGIN, BOUNDS)
        _, motion, functional = elongation(images)
        covariances.append(covariance_in_time(motion, images, functional[None])[0])
    assert np.array_equal(*covariances)

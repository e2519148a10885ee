from __future__ import annotations

import numpy as np

from driver.dic.derived_quantities import readings, without_penalty
from driver.dic.grip_check import WithoutPenalty, grip_motion
from driver.dic.series import measure
from driver.dic.surface_images import prepare
from meshes.arrays import FloatArray
from tests.driver.dic.conftest import BOUNDS, ORIGIN, PIXEL, Field, Scene, deformed, zero

LENGTH = 7.04  # of the scene [µm]
RATIO = 5e-4  # elongation over stage travel
STAGE = np.linspace(0.0, 300.0, 49)


def localised(elongation: float) -> Field:
    """v of a specimen whose ends part by so much.

    Its strain is 1.6 times the mean half-way and 0.4 times the mean at the ends.
    """

    def v(x: FloatArray, y: FloatArray) -> FloatArray:
        along = y / LENGTH
        shape = along - 0.6 * np.sin(2.0 * np.pi * along) / (2.0 * np.pi)
        return np.asarray(elongation * (shape + 0.0 * x))

    return v


def test_the_ratio_of_a_specimen_that_stretches_less_at_its_ends_is_that_of_its_ends(
    scene: Scene,
) -> None:
    images = scene([(zero, localised(RATIO * s), zero) for s in STAGE], noise=0.009)
    motion = measure(images, roughness="estimated")
    read = readings(motion, images, LENGTH, motion, np.eye(STAGE.size))["elongation"]
    free = without_penalty(motion, images, LENGTH)
    one, all_ = np.zeros(STAGE.size, dtype=np.int64), np.ones(STAGE.size, dtype=bool)
    penalised, found = (
        grip_motion(STAGE, read.value, read.own, one, all_, 1.0, WithoutPenalty(*apart, read.held))
        for apart in ((free.value, np.inf), (free.value, free.sigma))
    )
    slope, sigma = np.polyfit(STAGE, read.value, 1)[0], penalised.ratio.sigma
    assert slope > RATIO + 5 * np.sqrt(sigma**2 - (penalised.held * slope) ** 2)
    assert found.unpenalised and abs(found.ratio.value - RATIO) < 2 * found.ratio.sigma
    assert found.ratio.sigma < sigma


def test_without_a_penalty_nothing_is_taken_back(scene: Scene) -> None:
    images = scene([(zero, localised(0.1), zero)], noise=0.002)
    motion = measure(images, roughness=np.inf)
    read = readings(motion, images, LENGTH, motion, np.eye(1))["elongation"]
    np.testing.assert_allclose(without_penalty(motion, images, LENGTH).value, read.value)


def test_the_motion_without_penalty_is_that_of_a_correlation_without(scene: Scene) -> None:
    images = scene([(zero, localised(0.05 * k), zero) for k in range(3)], noise=0.009)
    held, none = (measure(images, roughness=r) for r in (0.01, np.inf))
    read = readings(none, images, LENGTH, none, np.eye(3))["elongation"]
    free = without_penalty(held, images, LENGTH)
    assert np.all(np.abs(free.value - read.value) < 0.3 * free.sigma)
    # Interpolation smoothes the noise of an image, so that it scatters by less than stated.
    assert read.single <= free.sigma * np.sqrt(1 + 1 / images.n_reference)


def test_a_frame_that_lacks_pixels_is_read_without_penalty_as_by_a_correlation_without() -> None:
    rng = np.random.default_rng(5)
    frames = np.array([deformed(zero, localised(0.06 * k), zero) for k in range(3)])
    repeats = np.repeat(deformed(zero, zero, zero)[None], 10, axis=0)
    frames, repeats = (s + 0.009 * rng.standard_normal(s.shape) for s in (frames, repeats))
    frames[1, 18:30, 30:44] = np.nan
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    held, none = (measure(images, roughness=r) for r in (0.01, np.inf))
    assert not held.compared[1].all()
    read = readings(none, images, LENGTH, none, np.eye(3))["elongation"]
    free = without_penalty(held, images, LENGTH)
    taken = readings(held, images, LENGTH, held, np.eye(3))["elongation"]
    off = np.abs(free.value - read.value)
    assert off[1] < 0.3 * free.sigma and off[1] < 0.5 * abs(taken.value[1] - read.value[1])

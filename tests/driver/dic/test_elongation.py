from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.dic.surface_images import SurfaceImages

Field = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]
Scene = Callable[..., SurfaceImages]
LENGTH = 7.04


def affine(offset: float, slope_y: float) -> Field:
    return lambda x, y: offset + slope_y * (y + 0 * x)


def test_elongation_and_tilt_are_measured_whatever_the_stage_does(scene: Scene) -> None:
    stretch, slope = 0.012, 0.005
    stage = [(0.0, 0.0, 0.0), (0.21, -0.17, 0.05), (-0.1, 0.25, -0.07)]
    motions = [(affine(a, 0.0), affine(b, stretch), affine(c, slope)) for a, b, c in stage]
    images = scene(motions, noise=1e-5)
    edges = edge_motion(measure(images), images, 0.0, LENGTH)
    assert edges.elongation == pytest.approx(np.full(3, stretch * LENGTH), abs=3e-4)
    assert edges.tilt == pytest.approx(np.full(3, slope * LENGTH), abs=1e-4)
    assert edges.minus == pytest.approx(np.array(stage), abs=3e-4)


def test_a_strip_measures_between_the_middles_of_the_strips(scene: Scene) -> None:
    images = scene([(affine(0, 0), affine(0, 0.012), affine(0, 0))], noise=1e-5)
    motion = measure(images)
    edges = edge_motion(motion, images, 0.0, LENGTH, band=1.0)
    assert edges.elongation[0] == pytest.approx(0.012 * (LENGTH - 1.0), abs=3e-4)
    assert edges.elongation_sigma < edge_motion(motion, images, 0.0, LENGTH).elongation_sigma


def test_the_stated_sigma_is_the_scatter_of_the_elongation(scene: Scene) -> None:
    n_draws = 60
    images = scene([(affine(0.04, 0), affine(-0.02, 0.012), affine(0, 0))] * n_draws, noise=0.009)
    edges = edge_motion(measure(images), images, 0.0, LENGTH)
    own = 1 / np.sqrt(1 + 1 / images.n_reference)  # the frames share the rest
    sampling = 3 / np.sqrt(2 * (n_draws - 1))
    of_tilt = np.array([0.0, 0.0, -1.0, 0.0, 0.0, 1.0])
    once_more = 1 + 1 / images.n_reference
    tilt_sigma = float(np.sqrt(of_tilt @ edges.covariance_one @ of_tilt * once_more))
    for values, sigma in (
        (edges.elongation, edges.elongation_sigma),
        (edges.tilt, tilt_sigma),
    ):
        assert values.std(ddof=1) == pytest.approx(own * sigma, rel=sampling)
    assert edges.elongation.mean() == pytest.approx(
        0.012 * LENGTH, abs=3 * edges.elongation_sigma * np.sqrt(1 / 10 + 1 / n_draws)
    )


def test_an_edge_off_the_measured_surface_is_refused(scene: Scene) -> None:
    images = scene([(affine(0, 0), affine(0, 0), affine(0, 0))], noise=0.001)
    with pytest.raises(ValueError, match="end before the edge Y = -0.5 µm"):
        edge_motion(measure(images), images, -0.5, LENGTH)

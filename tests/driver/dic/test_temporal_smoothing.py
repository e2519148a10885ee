from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from driver.dic.covariance import covariance_in_time
from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.dic.surface_images import SurfaceImages
from driver.dic.temporal_smoothing import smooth_along_travel, smoothed_motion
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import FloatArray
from tests.driver.dic.conftest import PIXEL

Field = Callable[[np.ndarray, np.ndarray], np.ndarray]
Scene = Callable[..., SurfaceImages]

TRAVEL = np.concatenate([np.arange(0.0, 100.0, 5.0), np.arange(100.0, 40.0, -5.0)])


def test_a_motion_linear_between_turning_points_passes_unchanged() -> None:
    motion = np.stack([0.3 * TRAVEL - 1.0, np.where(np.arange(32) <= 20, TRAVEL, 100.0)], axis=1)
    smoothed = smooth_along_travel(motion, TRAVEL, 20.0, 10)
    assert smoothed.coefficients == pytest.approx(motion, abs=1e-9)


def test_the_scatter_over_draws_has_the_stated_covariance() -> None:
    rng = np.random.default_rng(4)
    n_draws, n_reference = 4000, 4
    own = rng.normal(size=(len(TRAVEL), n_draws))
    shared = rng.normal(size=n_draws) / np.sqrt(n_reference)
    smoothed = smooth_along_travel(own + shared, TRAVEL, 10.0, n_reference)
    found = np.cov(smoothed.coefficients)
    # standard error of a variance of 4000 draws: 2.2 %
    assert found == pytest.approx(smoothed.covariance_in_time, abs=0.1)
    gain = smoothed.covariance_in_time.diagonal() / (1 + 1 / n_reference)
    assert (gain < 1).all() and gain[10] < 0.6


@pytest.mark.parametrize(
    ("travel", "length", "said"),
    [
        (TRAVEL[:-1], 10.0, "there are 32 images"),
        (TRAVEL, 0.0, "length = 0.0 µm"),
        (np.zeros(32), 10.0, "did not travel"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(travel: np.ndarray, length: float, said: str) -> None:
    with pytest.raises(ImageError, match=said):
        smooth_along_travel(np.zeros((32, 2)), travel, length, 10)


def test_a_frame_that_is_left_out_follows_its_neighbours_and_spoils_none() -> None:
    motion = 0.3 * TRAVEL[:, None] - 1.0
    spoilt, kept = motion.copy(), np.ones(len(TRAVEL), dtype=bool)
    spoilt[7] += 50.0
    kept[7] = False
    smoothed = smooth_along_travel(spoilt, TRAVEL, 10.0, 10, None, kept)
    assert smoothed.coefficients == pytest.approx(motion, abs=1e-3)


def test_the_stage_is_not_smoothed_and_the_elongation_scatters_as_stated(scene: Scene) -> None:
    travel = np.concatenate([np.linspace(0, 60, 13), np.linspace(55, 30, 6)])
    rng = np.random.default_rng(6)
    stage = rng.uniform(-0.4, 0.4, (len(travel), 2)) * PIXEL

    def motion(t: int) -> tuple[Field, Field, Field]:
        (a, b), strain = stage[t], 1e-4 * travel[t]
        return (
            lambda x, y: a + 0 * x * y,
            lambda x, y: b + strain * (y - 3.5) + 0 * x,
            lambda x, y: 0 * x * y,
        )

    found: list[FloatArray] = []
    plain: list[FloatArray] = []
    stated, chi = [], []
    for seed in range(8):
        images = scene([motion(t) for t in range(len(travel))], noise=0.009, seed=20 + seed)
        measured = measure(images)
        smoothed, smoother = smoothed_motion(measured, images, travel, 12.0)
        mean = smoothed.at_pixels().mean(axis=1)
        # The stage's shifts of up to 0.4 px are those of each image by itself.
        assert mean == pytest.approx(measured.at_pixels().mean(axis=1), abs=1e-12)
        for motions, values in ((measured, plain), (smoothed, found)):
            edges = edge_motion(motions, images, 0.0, 7.04)
            values.append(edges.elongation - 7.04e-4 * travel)
        raw = covariance_in_time(measured, images, edges.difference(1)[None])[0]
        stated.append((smoother @ raw @ smoother.T).diagonal())
        chi.append(smoothed.chi)
    square, before = np.mean(np.square(found)), np.mean(np.square(plain))
    # 8 draws of 19 images, neighbours and reference shared: some 40 degrees of freedom, 22 %
    assert square == pytest.approx(np.mean(stated), rel=0.5)
    assert square < 0.6 * before
    assert np.mean(chi) == pytest.approx(1.0, abs=0.01)


def test_a_hold_of_many_images_is_a_turning_point() -> None:
    travel = np.array([0.0, 5, 10, 15, 15, 15, 15, 20, 25, 30])
    rests = np.where(travel < 15, 0.2 * travel, 3.0)
    rests[4:7] = [4.0, 2.0, 5.0]  # whatever it does while the stage rests
    rests[7:] = 5.0 + 0.1 * (travel[7:] - 15)
    smoothed = smooth_along_travel(rests[:, None], travel, 20.0, 10)
    assert smoothed.coefficients[:, 0] == pytest.approx(rests, abs=1e-9)

from __future__ import annotations

import numpy as np

from driver.identification.load_noise import whiten_markov
from meshes.arrays import FloatArray, IntArray

A = 0.7


def covariance(frames: IntArray) -> FloatArray:
    """Of AR(1) noise of unit variance."""
    return np.asarray(A ** np.abs(frames[:, None] - frames[None]))


def test_noise_across_a_gap_is_whitened_by_how_long_the_gap_is() -> None:
    for frames in (np.arange(9), np.array([0, 1, 2, 7, 8, 12])):
        root = whiten_markov(np.eye(frames.size), frames, A).T
        np.testing.assert_allclose(
            root @ covariance(frames) @ root.T, np.eye(frames.size), atol=1e-12
        )


def test_repeated_frames_are_readings_that_follow_one_another() -> None:
    twice = whiten_markov(np.eye(4), np.repeat(np.arange(2), 2), A)
    np.testing.assert_array_equal(twice, whiten_markov(np.eye(4), np.arange(4), A))


def test_white_noise_is_left_alone() -> None:
    load = np.arange(5.0)
    assert whiten_markov(load, np.arange(5), 0.0) is load

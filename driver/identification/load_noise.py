"""Noise of the loads: its whitening over frames of which some are missing."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray, IntArray


def whiten_markov(load: FloatArray, frames: IntArray, autocorrelation: float) -> FloatArray:
    """Return the unit AR(1) noise turned into independent unit numbers.

    Noise that goes on between the frames in use, a to the next frame, is correlated by a^Δ over
    Δ frames: the reading before a gap says little of the one after it.

    Args:
        load: of the frames, last axis, over γ_F, shape (..., T).
        frames: numbers of the frames, shape (T,); a frame that is repeated has readings that
            follow one another.
        autocorrelation: a, of the noise from one frame to the next [-].

    Returns:
        Shape (..., T).
    """
    if not autocorrelation:
        return load
    kept = autocorrelation ** np.maximum(np.diff(frames), 1)
    rest = (load[..., 1:] - kept * load[..., :-1]) / np.sqrt(1 - kept**2)
    return np.concatenate([load[..., :1], rest], axis=-1)

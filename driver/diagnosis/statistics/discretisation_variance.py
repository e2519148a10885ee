"""Variance of scores: that of noise, and what the finer simulation itself leaves wrong.

Whitened numbers count that error as a field that is as likely to look like one thing as like
another. It is not: a mesh errs where crystals yield, as most causes do. How much more of it shows
along the causes is seen in the patterns of what is left (`identification.mesh_error`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.diagnosis.statistics.score_test import Score
from driver.identification.data import Data
from meshes.arrays import FloatArray

_OF_THE_SPECIMEN = ("material", "microstructure", "boundary")


def score_variance(
    scores: Sequence[Score], data: Data, left: Sequence[tuple[FloatArray, FloatArray]]
) -> float:
    """Variance of what whitened data show along the causes of the specimen, 1 for noise alone.

    Args:
        scores: of the causes, for noise alone.
        data: the data.
        left: patterns of what the finer simulation leaves wrong, one standard deviation of each:
            motion at the pixels [µm], shape (T, n_pix, 3), and load [µN], (T,).
    """
    along = [s.directions for s in scores if s.cause.category in _OF_THE_SPECIMEN]
    directions = np.concatenate([rows for rows in along if rows.size] or [np.zeros((0, 0))])
    if not directions.size or not left:
        return 1.0
    seen = [np.mean((directions @ data.change(motion, load)) ** 2) for motion, load in left]
    counted = 1.0 - float(np.mean(np.sum(data.noise_part(directions) ** 2, axis=1)))
    return 1.0 + max(0.0, float(np.sum(seen)) - counted)

"""Variance of scores: that of noise, and what the finer simulation itself leaves wrong.

Whitened numbers count that error as a field that is as likely to look like one thing as like
another. It is not: a mesh errs where crystals yield, as most causes do. How much more of it shows
along the causes is seen in the finer-minus-working difference c: of two meshes that err each in
its own way, in proportion to their sizes, the finer one keeps the share r²/(1 + r²) of |c|², with
r = h_fine/h_working. (A test of known truth on 942 cells, identified with 262 and 574, confirms
it: what the correction leaves has a cosine of −0.40 to c, and such errors give −0.44.)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from driver.diagnosis.statistics.score_test import Score
from driver.identification.data import Data
from driver.identification.objective import Correction

_OF_THE_SPECIMEN = ("material", "microstructure", "boundary")


def score_variance(
    scores: Sequence[Score], data: Data, correction: Correction, sizes: tuple[float, float]
) -> float:
    """Variance of what whitened data show along the causes of the specimen, 1 for noise alone.

    Args:
        scores: of the causes, for noise alone.
        data: the data.
        correction: finer minus working prediction.
        sizes: element sizes of the working and of the finer mesh [µm].
    """
    along = [s.directions for s in scores if s.cause.category in _OF_THE_SPECIMEN]
    directions = np.concatenate([rows for rows in along if rows.size] or [np.zeros((0, 0))])
    if not directions.size or not isinstance(correction.load, np.ndarray):
        return 1.0
    # What steps of first order leave is in the covariance, with its own pattern.
    difference = data.change(*correction.of_mesh)
    ratio = sizes[1] / sizes[0]
    left = ratio**2 / (1.0 + ratio**2) * float(np.mean((directions @ difference) ** 2))
    counted = 1.0 - float(np.mean(np.sum(data.noise_part(directions) ** 2, axis=1)))
    return 1.0 + max(0.0, left - counted)

from __future__ import annotations

import numpy as np
import pytest

from driver.experiment.images.stated_noise import contradiction


@pytest.mark.parametrize(
    ("stated", "seen", "chi", "noise"),
    [
        (3.0, 9.0, 3.0, "9"),  # the residuals in time say how large it is
        (9.0, 3.0, 0.33, "3"),
        (3.0, np.nan, 3.0, "9"),  # too few images for that: χ does
        (9.0, 9.2, 1.4, ""),
        (9.0, 9.2, 3.0, ""),  # a model error of the correlation is no noise
    ],
)
def test_a_stated_noise_is_held_against_the_residuals(
    stated: float, seen: float, chi: float, noise: str
) -> None:
    told = contradiction(1e-3 * stated, 1e-3 * seen, np.full(5, chi))
    assert bool(told) == bool(noise)
    if noise:
        assert told.startswith(f"images.noise_nm: found {stated:g}, but free correlation leaves χ")
        assert f"scatter as a noise of {noise} nm does" in told

from __future__ import annotations

import numpy as np
import pytest

from driver.noise_floor.motions import KnownMotion, known_motions

MOTIONS = known_motions(0.11, 12.0, 4.0, 0.02)


@pytest.mark.parametrize("motion", MOTIONS, ids=lambda motion: motion.name)
def test_slopes_are_the_derivatives_of_the_values(motion: KnownMotion) -> None:
    x, y = np.random.default_rng(0).uniform((-2, 0), (2, 12), (50, 2)).T
    _, slopes = motion(x, y)
    step = 1e-5
    for axis, (dx, dy) in enumerate(((step, 0.0), (0.0, step))):
        ahead, behind = motion(x + dx, y + dy)[0], motion(x - dx, y - dy)[0]
        np.testing.assert_allclose(slopes[..., axis], (ahead - behind) / (2 * step), atol=1e-9)


def test_the_motions_are_of_every_kind_and_of_the_stated_size() -> None:
    assert [motion.kind for motion in MOTIONS] == (
        ["rigid"] * 3 + ["affine"] * 2 + ["out of plane"] * 2 + ["wave"] * 2
    )
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(-2, 2, 41), np.linspace(0, 12, 121)))
    seen = {motion.name: motion(x, y) for motion in MOTIONS}
    np.testing.assert_allclose(seen["shift 0.25, -0.45 px"][0][0], [0.0275, -0.0495, 0.0])
    np.testing.assert_allclose(seen["strain 1.5%"][1][:, 1, 1], 0.015)
    assert np.ptp(seen["tilt 40 nm"][0][:, 2]) == pytest.approx(0.04)
    for name in ("sine of one wavelength", "cosine of one wavelength"):
        value, slopes = seen[name]
        assert np.abs(slopes[:, 1, 1]).max() == pytest.approx(0.01, rel=1e-2)
        assert np.abs(slopes[:, 0, 0]).max() == pytest.approx(0.01, rel=1e-2)
        # One wavelength over the specimen: both ends move alike.
        np.testing.assert_allclose(value[y == 0, 1], value[y == 12, 1], atol=1e-12)

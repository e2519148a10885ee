from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from driver.experiment.images.heightmaps import ImageError
from driver.experiment.images.noise import noise_from_repeats, temporal_noise


def test_noise_is_measured_through_drift_and_tilt_of_the_stage() -> None:
    rng = np.random.default_rng(4)
    row, col = np.indices((40, 60)) / 40.0
    surface = 0.1 * np.sin(20 * row) + 0.1 * np.cos(15 * col)
    drift = rng.normal(scale=0.05, size=(10, 3))
    repeats = surface + np.array([a + b * row + c * col for a, b, c in drift])
    repeats = repeats + 0.009 * rng.normal(size=repeats.shape)
    mask = (row > 0.2) & (row < 0.8)
    noise = noise_from_repeats(repeats, mask)
    assert noise.dof == 9 * (mask.sum() - 3)
    assert abs(noise.sigma / 0.009 - 1) < 3 / np.sqrt(2 * noise.dof)


def test_repeats_that_tell_nothing_are_refused() -> None:
    mask = np.ones((4, 4), bool)
    with pytest.raises(ImageError, match="1 frames"):
        noise_from_repeats(np.ones((1, 4, 4)), mask)
    with pytest.raises(ImageError, match="identical"):
        noise_from_repeats(np.ones((3, 4, 4)), mask)


def test_the_degrees_of_freedom_of_repeats_are_those_of_chi_squared() -> None:
    rng = np.random.default_rng(8)
    mask = np.ones((6, 7), bool)
    found = [noise_from_repeats(rng.normal(size=(4, 6, 7)), mask) for _ in range(1500)]
    dof = 3 * (42 - 3)
    assert {noise.dof for noise in found} == {dof}
    squares = np.array([dof * noise.sigma**2 for noise in found])
    assert kstest(squares, chi2(dof).cdf).pvalue > 0.01
    assert kstest(squares, chi2(dof + 9).cdf).pvalue < 1e-6  # the test can tell


def test_temporal_noise_is_blind_to_reference_and_slow_errors_and_knows_its_freedom() -> None:
    rng = np.random.default_rng(9)
    T, n = 60, 4000
    slow = np.outer(np.linspace(0, 5, T), rng.normal(size=n))  # linear in time, 5σ at the end
    shared = 3.0 * rng.normal(size=n)
    gain = rng.uniform(0.3, 1.0, size=(T, n))
    residual = shared + slow + np.sqrt(gain) * rng.normal(size=(T, n))
    found = temporal_noise(zip(residual, gain, strict=True), np.zeros(n))
    assert found is not None
    assert abs(found.sigma - 1) < 3 / np.sqrt(2 * found.dof)
    # Of a χ²/ν estimate the variance is 2/ν. 4000 of them give it to 2.5 %.
    assert 2 / np.var(found.map**2) == pytest.approx(found.map_dof, rel=0.08)
    assert not found.larger.any()
    residual[:, 100:140] += 2.0 * rng.normal(size=(T, 40))
    noisier = temporal_noise(zip(residual, gain, strict=True), np.zeros(n))
    assert noisier is not None
    assert noisier.larger[100:140].mean() > 0.9
    assert noisier.larger.sum() == noisier.larger[100:140].sum()
    assert temporal_noise(zip(residual[:2], gain[:2], strict=True), np.zeros(n)) is None


def test_what_a_fit_takes_from_the_residuals_is_given_back() -> None:
    rng = np.random.default_rng(10)
    modes = np.linalg.qr(rng.normal(size=(500, 100)))[0]
    residual = rng.normal(size=(80, 500))
    residual -= (residual @ modes) @ modes.T
    found = temporal_noise(((rho, np.ones(500)) for rho in residual), (modes**2).sum(axis=1))
    assert found is not None
    assert abs(found.sigma - 1) < 3 / np.sqrt(2 * found.dof)

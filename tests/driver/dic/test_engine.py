"""One engine behind the measure stage and the correlation of plain arrays."""

from __future__ import annotations

import numpy as np
import pytest

from driver.dic.correlation import Correlation, Options, correlate
from driver.dic.series import Roughness, SurfaceMotion, measure
from driver.dic.surface_images import prepare
from meshes.arrays import FloatArray
from meshes.plane_mesh import PlaneMesh
from tests.driver.dic.conftest import BOUNDS, ORIGIN, PIXEL, constant, deformed, zero
from tests.meshes.plane_examples import distorted

SIGMA = 0.006


def wavy(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.asarray(0.03 * np.sin(2 * np.pi * (y + 0.3 * x) / 4.0))


def series() -> tuple[FloatArray, FloatArray]:
    """Four frames in motion, the last one with a hole, and ten repeats [µm]."""
    rng = np.random.default_rng(3)
    shifts = (0.0, 0.4, 2.3, -1.2)
    frames = np.array([deformed(wavy, constant(k * PIXEL), zero) for k in shifts])
    repeats = np.repeat(deformed(zero, zero, zero)[None], 10, axis=0)
    frames += SIGMA * rng.normal(size=frames.shape)
    frames[3, 20:26, 30:40] = np.nan
    return frames, repeats + SIGMA * rng.normal(size=repeats.shape)


def both(roughness: float | None) -> tuple[SurfaceMotion, Correlation]:
    """The motion of a series by the stage, and of its arrays with the gradient of the stage."""
    frames, repeats = series()
    images = prepare(frames, repeats, None, PIXEL, ORIGIN, BOUNDS)
    square = distorted("quad4")
    mesh = PlaneMesh(square.points * [1.2, 2.4] - [1.8, 0.05], square.cells, "quad4")
    granted: Roughness = "estimated" if roughness is None else roughness * PIXEL
    measured = measure(images, mesh, mesh, granted, penalty="tikhonov")
    mask = np.zeros(images.shape, dtype=bool)
    mask[images.rows, images.cols] = True
    gradient = np.zeros((*images.shape, 2))
    gradient[mask] = measured.system.pixels.slope
    moved = PlaneMesh(mesh.points + PIXEL * np.array(ORIGIN), mesh.cells, "quad4")
    correlated = correlate(
        images.reference_image,
        frames,
        PIXEL,
        mask,
        moved,
        moved,
        images.sigma,
        images.n_reference,
        Options("tikhonov", roughness, roughness_w=np.inf, tolerance=1e-4),
        gradient,
    )
    return measured, correlated


@pytest.mark.parametrize(
    ("roughness", "within"),
    # The estimate ends where a change would hardly be felt; the rest is the tolerance.
    [(np.inf, 1e-5), (0.05, 1e-5), (None, 1e-3)],
)
def test_arrays_of_a_series_have_the_motion_that_the_stage_measures(
    roughness: float | None, within: float
) -> None:
    measured, correlated = both(roughness)
    assert measured.converged.all() and correlated.converged.all()
    assert correlated.roughness * PIXEL == pytest.approx(measured.roughness, rel=0.01)
    difference = np.abs(measured.coefficients - correlated.coefficients).max(axis=1) / PIXEL
    assert difference[:3].max() < within
    assert correlated.chi[:3] == pytest.approx(measured.chi[:3], rel=within)
    # Which pixels at the rim of a hole are compared depends on where the frame starts.
    assert difference[3] < 0.03
    whole = np.isfinite(correlated.residual).all(axis=1)
    assert whole.tolist() == measured.compared.all(axis=1).tolist() == [True, True, True, False]


def test_an_image_of_another_surface_has_no_say_in_noise_and_roughness() -> None:
    frames, repeats = series()
    reference = repeats.mean(axis=0)
    mask = np.zeros(reference.shape, dtype=bool)
    mask[6:-6, 6:-6] = True
    alone = correlate(reference, frames[:3], PIXEL, mask, n_reference=10)
    other = 1e3 * np.random.default_rng(11).normal(size=reference.shape)
    beside = correlate(reference, [*frames[:3], other], PIXEL, mask, n_reference=10)
    assert beside.lost.tolist() == [False, False, False, True]
    assert beside.sigma == pytest.approx(alone.sigma, rel=1e-9)
    assert beside.roughness == pytest.approx(alone.roughness, rel=1e-9)
    # The relief of 50 nm stands for its residual.
    assert beside.chi[3] > 5 and beside.chi[:3] == pytest.approx(1.0, abs=0.1)

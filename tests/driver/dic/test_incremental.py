"""Each image against the one before: textures in closed form, some of which change on the way."""

from __future__ import annotations

import numpy as np
import pytest

from driver.dic.basis import grid_basis
from driver.dic.correlation import Options, correlate
from driver.dic.incremental import IncrementalCorrelation, correlate_incrementally
from driver.experiment.images.heightmaps import ImageError
from meshes.arrays import BoolArray, FloatArray

N, NOISE, STEPS = 72, 1.0, 4
MIDDLE = (N - 1) / 2
FINAL = np.array([[-0.04, 0.06], [-0.06, 0.12]])
PLAIN = Options(roughness=np.inf)


def texture(seed: int, x: FloatArray, y: FloatArray) -> FloatArray:
    """Waves of 7 to 20 px in all directions, 27 rms."""
    rng = np.random.default_rng(seed)
    heights = np.zeros(x.shape)
    for length, angle, phase in rng.uniform((7, 0, 0), (20, np.pi, 2 * np.pi), (60, 3)):
        along = np.cos(angle) * x + np.sin(angle) * y
        heights += 5.0 * np.cos(2 * np.pi / length * along + phase)
    return heights


def moved(k: int, change: float) -> FloatArray:
    """Image k: the texture after a stretch, a turn and a shift, and turned into another one."""
    gradient, shift = np.eye(2) + FINAL * k / STEPS, np.array([1.7, -1.1]) * k
    place = np.moveaxis(np.indices((N, N), dtype=float), 0, -1) - MIDDLE - shift
    x, y = np.moveaxis(place @ np.linalg.inv(gradient).T + MIDDLE, -1, 0)
    mix = change * k / STEPS
    return np.asarray(np.cos(mix) * texture(1, x, y) + np.sin(mix) * texture(2, x, y))


def truth(places: FloatArray, k: int = STEPS) -> FloatArray:
    return np.asarray((places - MIDDLE) @ (FINAL * k / STEPS).T + np.array([1.7, -1.1]) * k)


def region() -> BoolArray:
    mask = np.zeros((N, N), dtype=bool)
    mask[14:-14, 14:-14] = True
    mask[30:34, 40:44] = False  # a hole that is carried along
    return mask


CLEAN = {change: [moved(k, change) for k in range(STEPS + 1)] for change in (0.0, np.pi / 2)}


def found(seed: int, change: float = 0.0) -> IncrementalCorrelation:
    rng = np.random.default_rng(seed)
    f, *images = (clean + NOISE * rng.normal(size=(N, N)) for clean in CLEAN[change])
    return correlate_incrementally(
        f, images, mask=region(), mesh_uv=22, mesh_w=44, sigma=NOISE, options=PLAIN
    )


def test_the_steps_add_up_to_the_motion_with_the_stated_sigma() -> None:
    draws = [found(seed) for seed in range(6)]
    first = draws[0]
    n = len(first.basis_uv.nodes)
    nodes = np.eye(2 * n, first.coefficients.shape[1])
    for k in (1, STEPS):
        expected = truth(first.basis_uv.nodes, k).T.ravel()
        sigma = first.sigma_of(nodes, k - 1)
        off = np.array([one.coefficients[k - 1, : 2 * n] - expected for one in draws]) / sigma
        # 6 draws of 2 n = 32 nodal values, neighbours correlated.
        assert np.sqrt(np.mean(off**2)) == pytest.approx(1.0, abs=0.2)
    # The noise of images on the way nearly falls out: four steps are about as sure as one.
    assert (first.sigma_of(nodes) < 1.5 * first.sigma_of(nodes, 0)).all()
    assert first.converged.all()


def test_the_mask_is_carried_along() -> None:
    last = found(0).steps[-1].residual_map()
    # The hole has gone with the surface: its middle is where it was three steps later.
    row, col = np.rint(np.array([31.5, 41.5]) + truth(np.array([31.5, 41.5]), STEPS - 1))
    assert np.isnan(last[int(row), int(col)]) and np.isfinite(last[31, 41])


def test_a_pattern_that_becomes_another_one_is_followed_where_one_step_loses_it() -> None:
    change, places = np.pi / 2, np.argwhere(region()).astype(float)
    rng = np.random.default_rng(0)
    f, last = (CLEAN[change][k] + NOISE * rng.normal(size=(N, N)) for k in (0, STEPS))
    direct = correlate(f, last, mask=region(), mesh_uv=22, mesh_w=44, sigma=NOISE, options=PLAIN)
    expected = truth(places)
    by_steps = found(0, change).at_pixels()[:, :2] - expected
    at_once = direct.at_pixels()[:, :2] - expected
    # What each change of the pattern pulls adds up; nothing of it is seen in one step.
    assert np.sqrt(np.mean(by_steps**2)) < 2.0 < 0.5 * np.sqrt(np.mean(at_once**2))


def test_meshes_that_cannot_be_carried_and_lost_images_are_told() -> None:
    f = CLEAN[0.0][0]
    small, large = (
        grid_basis(np.array([[30.0, 30.0]]), (low, high, low, high), 15.0).mesh
        for low, high in ((20.0, 50.0), (10.0, 60.0))
    )
    with pytest.raises(ImageError, match="mesh_w has nodes outside mesh_uv"):
        correlate_incrementally(f, [f], mesh_uv=small, mesh_w=large)
    with pytest.raises(ImageError, match="image 1 of"):
        correlate_incrementally(f, [f, f[:-1]])

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from driver.dic.surface_images import SurfaceImages, prepare
from meshes.arrays import FloatArray

Field = Callable[[FloatArray, FloatArray], FloatArray]
Scene = Callable[..., SurfaceImages]

PIXEL = 0.11
SHAPE = (48, 88)
ORIGIN = (23.5, 12.0)
BOUNDS = (-1.76, 1.76, 0.0, 7.04)


def relief(x: FloatArray, y: FloatArray) -> FloatArray:
    """Heights [µm] of a smooth random relief, 50 nm rms, 8 to 16 px wavelength, closed form."""
    rng = np.random.default_rng(7)
    height = np.full(np.broadcast_shapes(x.shape, y.shape), 0.5)
    for angle, wavelength, phase in rng.uniform((0, 8, 0), (np.pi, 16, 2 * np.pi), (50, 3)):
        k = 2 * np.pi / (wavelength * PIXEL)
        height = height + 0.01 * np.cos(k * (np.cos(angle) * x + np.sin(angle) * y) + phase)
    return height


def zero(x: FloatArray, y: FloatArray) -> FloatArray:
    return np.zeros(np.broadcast_shapes(x.shape, y.shape))


def constant(value: float) -> Field:
    return lambda x, y: np.full(np.broadcast_shapes(x.shape, y.shape), value)


def deformed(u: Field, v: Field, w: Field) -> FloatArray:
    """The image g with g(x + u, y + v) = f + w: the material point is found by fixed point."""
    row, col = np.indices(SHAPE, dtype=np.float64)
    x_image, y_image = (row - ORIGIN[0]) * PIXEL, (col - ORIGIN[1]) * PIXEL
    x, y = x_image, y_image
    for _ in range(40):
        x, y = x_image - u(x, y), y_image - v(x, y)
    return relief(x, y) + w(x, y)


@pytest.fixture
def scene() -> Scene:
    """A maker of series of the analytic relief: motions (u, v, w), noise [µm], repeats, seed."""

    def make(
        motions: list[tuple[Field, Field, Field]],
        noise: float,
        n_repeats: int = 10,
        seed: int = 0,
    ) -> SurfaceImages:
        rng = np.random.default_rng(seed)
        clean = np.array([deformed(*motion) for motion in motions])
        repeats = np.repeat(deformed(zero, zero, zero)[None], n_repeats, axis=0)
        return prepare(
            clean + noise * rng.normal(size=clean.shape),
            repeats + noise * rng.normal(size=repeats.shape),
            None,
            PIXEL,
            ORIGIN,
            BOUNDS,
        )

    return make

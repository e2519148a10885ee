"""Large motions in one step, of a texture in closed form: no image is an interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.dic.correlation import correlate
from driver.dic.series import measure
from driver.dic.surface_images import prepare
from meshes.arrays import FloatArray

N, NOISE = 160, 0.5
BOX = slice(44, 116)
MIDDLE = (N - 1) / 2
AT = np.indices((N, N), dtype=float)


def texture(x: FloatArray, y: FloatArray) -> FloatArray:
    """Waves of 7 to 24 px in all directions, 40 rms."""
    rng = np.random.default_rng(3)
    heights = np.zeros(x.shape)
    for length, angle, phase in rng.uniform((7, 0, 0), (24, np.pi, 2 * np.pi), (130, 3)):
        along = np.cos(angle) * x + np.sin(angle) * y
        heights += 5.0 * np.cos(2 * np.pi / length * along + phase)
    return heights


def image(gradient: FloatArray, shift: tuple[float, float], seed: int) -> FloatArray:
    """The texture after x → F (x − m) + m + s, with noise."""
    place = np.moveaxis(AT, 0, -1) - MIDDLE - shift
    x, y = np.moveaxis(place @ np.linalg.inv(gradient).T + MIDDLE, -1, 0)
    noise = np.random.default_rng(seed).normal(size=x.shape)
    return np.asarray(texture(x, y) + NOISE * noise)


def turn(degrees: float) -> FloatArray:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


@pytest.mark.parametrize(
    ("gradient", "shift"),
    [
        (turn(20.0), (0.3, -0.2)),
        (np.eye(2), (42.3, -12.6)),  # more than half of the box of 72 px
        (np.diag([0.94, 1.2]), (0.2, 0.1)),
        (np.array([[1.0, 0.15], [0.0, 1.0]]), (0.0, 0.0)),
        (turn(15.0) @ np.diag([0.95, 1.15]), (12.0, -9.0)),
    ],
    ids=["turn of 20°", "shift of 42 px", "stretch of 20 %", "shear of 15 %", "all of them"],
)
def test_a_large_motion_is_found_in_one_step(
    gradient: FloatArray, shift: tuple[float, float]
) -> None:
    f, g = image(np.eye(2), (0.0, 0.0), 1), image(gradient, shift, 2)
    mask = np.zeros((N, N), dtype=bool)
    mask[BOX, BOX] = True
    truth = (np.argwhere(mask) - MIDDLE) @ (gradient - np.eye(2)).T + shift
    plain = correlate(f, g, mask=mask, mesh_w=16)
    bounds = (BOX.start, BOX.stop - 1, BOX.start, BOX.stop - 1)
    # Two copies that differ by a hair stand in for repeats; the true noise is stated after.
    copies = f + 1e-9 * np.random.default_rng(0).normal(size=(2, N, N))
    images = prepare(g[None], copies, None, 1.0, (0.0, 0.0), bounds, None, False)
    images = replace(images, sigma=NOISE, n_reference=1)
    staged = measure(images, 16.0, 16.0, roughness="estimated")
    for found, converged in (
        (plain.at_pixels(), plain.converged),
        (staged.at_pixels()[0], staged.converged),
    ):
        assert converged.all()
        # Noise of 0.5 on slopes of about 20 a pixel: some thousandths of a pixel a node.
        assert np.sqrt(np.mean((found[:, :2] - truth) ** 2)) < 0.004

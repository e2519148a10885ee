"""The renderer against closed forms, and against what correlation can see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.virtual.microscope.camera import Bits, Camera
from driver.virtual.microscope.face_motion import Face, NodalMotion
from driver.virtual.microscope.relief import Relief
from driver.virtual.microscope.series import Stage, Subject, flats, frames, repeats
from meshes.arrays import FloatArray
from meshes.prism import PrismGeometry, generate
from meshes.surface import trace

PIXEL, LENGTH, WIDTH = 0.11, 4.0, 2.0
NOISE = 0.009  # µm, of the microscope of the paper
EXX, EYY, BEND = -0.004, 0.012, 0.002


@pytest.fixture(scope="module")
def subject() -> Subject:
    """A strained and bent face: u = exx x, v = eyy y, w = bend y²; quadratic elements hold it."""
    face = Face(trace(generate(PrismGeometry(LENGTH, WIDTH, 1.7), 0.8)))
    x, y = face.mesh.points.T
    motion = np.column_stack([EXX * x, EYY * y, BEND * y**2])[None]
    relief = Relief.random(np.random.default_rng(0), (-2, 2, -1, 5), 0.02, 0.4, 0.9, 0.003)
    return Subject(face, motion, relief, None, np.inf)


def camera(bits: Bits = 32, samples: int = 1, noise: float = 0.0) -> Camera:
    x, y = np.meshgrid(np.arange(-7, 8) * PIXEL, np.arange(2, 33) * PIXEL, indexing="ij")
    pattern = np.zeros_like(x)
    sigma = np.full_like(x, noise)
    return Camera(x, y, PIXEL, pattern, sigma, bits, 0.0065, samples)


def closed_form(subject: Subject, x_now: FloatArray, y_now: FloatArray) -> FloatArray:
    x, y = x_now / (1 + EXX), y_now / (1 + EYY)
    return subject.relief(x, y) + BEND * y**2


def test_a_rendered_image_is_the_closed_form_to_rounding(subject: Subject) -> None:
    """f(X) + w(X) − g(X + u) = 0: what DIC leaves is four orders below a tenth of its noise."""
    scope = camera()
    found = scope.heights(subject.moved(0), np.zeros(2))
    error = np.abs(found - closed_form(subject, scope.x, scope.y)).max()
    slope = np.hypot(*np.gradient(closed_form(subject, scope.x, scope.y), PIXEL)).mean()
    assert error < 1e-10
    # As an apparent motion: far below the thousandth of a pixel that correlation resolves.
    assert error / slope < 1e-6 * PIXEL
    assert error < 1e-6 * NOISE / 10


def test_the_residual_at_the_true_motion_vanishes_at_any_material_point(subject: Subject) -> None:
    x, y = np.random.default_rng(1).uniform((-0.9, 0.1), (0.9, 3.9), (300, 2)).T
    residual = subject.relief(x, y) + BEND * y**2 - subject.moved(0)(x * (1 + EXX), y * (1 + EYY))
    assert np.abs(residual).max() < 1e-10


def test_the_residual_vanishes_in_a_motion_of_finite_elements_with_kinks(subject: Subject) -> None:
    """Random nodal motion: strains of a few per cent that jump from cell to cell."""
    rng = np.random.default_rng(5)
    nodal = rng.normal(0.0, 0.002, (1, len(subject.face.mesh.points), 3))
    kinked = replace(subject, motion=nodal)
    x, y = rng.uniform((-0.9, 0.1), (0.9, 3.9), (2000, 2)).T
    (u, v, w), slopes = (np.moveaxis(a, 1, 0) for a in NodalMotion(subject.face, nodal[0])(x, y))
    assert np.abs(slopes[:2]).max() > 0.03
    residual = subject.relief(x, y) + w - kinked.moved(0)(x + u, y + v)
    assert np.abs(residual).max() < 1e-10


def test_the_stage_carries_the_image_along(subject: Subject) -> None:
    scope, shift = camera(), np.array([0.03, -0.02])
    found = scope.heights(subject.moved(0), shift)
    truth = closed_form(subject, scope.x - shift[0], scope.y - shift[1])
    np.testing.assert_allclose(found, truth, atol=1e-10)


def test_a_pixel_averages_over_its_area(subject: Subject) -> None:
    """The mean of a wave over a pixel is its value times sinc in each direction."""
    bare = replace(subject.relief, dots=np.zeros((0, 2)))
    found = camera(samples=4).heights(replace(subject, relief=bare).at_rest, np.zeros(2))
    truth = np.zeros_like(found)
    scope = camera()
    for k, phase in zip(bare.waves.vectors, bare.waves.phases, strict=True):
        weight = np.prod(np.sinc(k * PIXEL / (2 * np.pi))) * bare.roughness * np.sqrt(2 / 40)
        truth += weight * np.cos(k[0] * scope.x + k[1] * scope.y + phase)
    np.testing.assert_allclose(found, truth, atol=1e-10)


@pytest.mark.parametrize(("bits", "kind"), [(8, np.uint8), (16, np.uint16), (32, np.float32)])
def test_levels_hold_the_heights_to_half_a_level(subject: Subject, bits: Bits, kind: type) -> None:
    scope = camera(bits)
    (image,) = frames(scope, subject, np.zeros((1, 3)), np.random.default_rng(2))
    assert image.dtype == kind
    ground = {8: 100, 16: 25600, 32: 0}[bits]
    error = scope.level * (image.astype(float) - ground) - closed_form(subject, scope.x, scope.y)
    largest = 1e-6 if bits == 32 else (0.5 + 1e-9) * scope.level
    assert np.abs(error).max() <= largest


def test_heights_beyond_the_levels_are_refused_and_not_cut(subject: Subject) -> None:
    with pytest.raises(ValueError, match="from level 2[0-9]+ to .* expected 1 to 255"):
        list(frames(camera(8), subject, np.array([[0, 0, 1.1]]), np.random.default_rng(0)))


@pytest.mark.parametrize("bits", [8, 16])
def test_the_trench_has_no_height_and_moves_with_the_face(subject: Subject, bits: Bits) -> None:
    cut = replace(subject, half_width=5.2 * PIXEL, motion=np.repeat(subject.motion, 2, axis=0))
    stage = np.array([[0.0, 0, 0], [PIXEL, 0, 0]])
    still, moved = frames(camera(bits), cut, stage, np.random.default_rng(0))
    inside = np.abs(np.arange(-7, 8)) <= 5
    np.testing.assert_array_equal((still.astype(float) > 0).all(axis=1), inside)
    np.testing.assert_array_equal((moved.astype(float) > 0).all(axis=1), np.roll(inside, 1))
    empty, _ = frames(camera(32), cut, stage, np.random.default_rng(0))
    np.testing.assert_array_equal(np.isfinite(empty).all(axis=1), inside)


def test_repeats_differ_by_white_noise_and_flats_show_the_pattern(subject: Subject) -> None:
    rng = np.random.default_rng(3)
    scope = replace(camera(noise=NOISE), pattern=camera().x * 0.01)
    stack = scope.level * np.array(repeats(scope, subject, 50, rng), dtype=float)
    # 50 · 465 pixels: known to 0.5 %.
    assert stack.std(axis=0, ddof=1).mean() == pytest.approx(NOISE, rel=0.02)
    stage = Stage(0.0, 0.03).errors(rng, 400)
    plain = scope.level * np.array(flats(scope, stage, rng), dtype=float) - stage[:, 2, None, None]
    np.testing.assert_allclose(plain.mean(axis=0), scope.pattern, atol=5 * NOISE / 20)


def test_the_stage_stays_within_its_largest_errors() -> None:
    errors = Stage(0.033, 0.03).errors(np.random.default_rng(4), 5000)
    assert np.abs(errors).max(axis=0) == pytest.approx([0.033, 0.033, 0.03], rel=1e-2)
    assert np.abs(errors).max(axis=0)[0] <= 0.033

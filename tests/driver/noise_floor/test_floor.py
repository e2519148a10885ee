from __future__ import annotations

import numpy as np
import pytest

from driver.dic.surface_images import SurfaceImages, prepare
from driver.experiment.images.heightmaps import ImageError
from driver.noise_floor.command import table
from driver.noise_floor.floor import chosen, relief_rms, sizes
from driver.results.noise_floor import QUANTITIES, Errors, Row


def row(size: float, elongation: float, strain: float) -> Row:
    nothing = {quantity: np.zeros(1) for quantity in QUANTITIES}
    scatter = nothing | {"elongation": np.array([elongation]), "strain": np.array([strain])}
    return Row(size, size / 2, Errors(nothing, scatter, 0.02, 1.0), 0.025)


def test_the_mesh_to_take_has_the_least_strain_error_among_those_of_good_elongation() -> None:
    rows = [row(8, 0.0100, 0.02), row(16, 0.0109, 0.01), row(32, 0.0111, 0.005)]
    assert chosen(rows).size == 16
    assert chosen(rows[:1]).size == 8


def test_the_table_marks_the_mesh_and_sets_both_noises_beside_the_paper() -> None:
    rows = [row(8, 0.01, 0.02), row(16, 0.01, 0.01)]
    lines = table(rows, rows[1], 9)
    (marked,) = [line for line in lines if "← take" in line]
    assert marked.startswith("        16") and "0 / 1 " in marked
    # 25 nm by 10 repeats: ± 25/√18.
    assert "predicted 20.0 nm, by 10 repeats 25.0 ± 5.9 nm; the paper 26 nm" in lines[-1]


def test_a_mesh_on_which_images_did_not_converge_is_named() -> None:
    stopped = row(8, 0.01, 0.02)
    stopped = Row(8, 4, Errors(stopped.errors.bias, stopped.errors.scatter, 0.02, 0.9), 0.025)
    assert table([stopped], stopped, 9)[-1].endswith("elements of 8 px")


def test_the_relief_is_measured_about_its_plane() -> None:
    x, y = np.meshgrid(np.arange(40.0), np.arange(60.0), indexing="ij")
    heights = 3.0 + 0.1 * x - 0.2 * y + 0.02 * np.cos(x * np.pi / 2) * np.cos(y * np.pi / 2)
    noise = 1e-6 * np.random.default_rng(0).normal(size=(3, *x.shape))
    face = (0.0, 3.95, 0.0, 5.95)
    noisy = heights + noise
    # Waves of four pixels would all be taken for dust.
    images = prepare(noisy[:1], noisy, None, 0.1, (0.0, 0.0), face, mask_dust=False)
    # A product of cosines sampled at 1, 0, −1, 0: half of half of its square.
    assert relief_rms(images) == pytest.approx(0.01, rel=1e-3)


def face(rows: int, columns: int) -> SurfaceImages:
    heights = 0.02 * np.random.default_rng(0).normal(size=(3, rows, columns))
    bounds = (0.0, 0.1 * (rows - 1), 0.0, 0.1 * (columns - 1))
    return prepare(heights[:1], heights, None, 0.1, (0.0, 0.0), bounds, mask_dust=False)


def test_the_meshes_begin_with_the_finest_that_pixels_and_memory_allow() -> None:
    assert sizes(face(40, 110), 0.5) == (8, 12, 16, 24, 32, 48)
    # Of 12 px, 34² nodes of u and of v and 67² of w are 6801 values; of 16 px they are 3953.
    assert sizes(face(400, 400), 0.5) == (16, 24, 32, 48, 64, 96)


def test_a_face_of_too_few_pixels_for_any_mesh_is_refused() -> None:
    with pytest.raises(ImageError, match="dic.element_px: found"):
        sizes(face(4, 4), 0.5)

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import tifffile

from driver.case.model import Case, load_case
from driver.common.errors import InputError
from driver.design.settings import Settings
from driver.design.surface import expected_surface
from driver.dic.slope_noise import SLOPE_GAIN
from driver.virtual.settings import Face, Microscope
from tools import closed_form
from tools.closed_form import PIXEL


def own_case(folder: Path) -> Case:
    closed_form.write_files(folder, {})
    (folder / "images.tif").unlink()
    return load_case(folder / "case.toml")


def test_the_users_repeats_give_noise_and_pattern_without_images(tmp_path: Path) -> None:
    case, history = own_case(tmp_path), closed_form.history()
    found = expected_surface(case, Settings(), history)
    assert found.images.sigma * 1e3 == pytest.approx(1e3 * closed_form.SIGMA, rel=0.05)
    assert found.images.n_reference == closed_form.N_REPEATS
    assert "10 repeats of the case" in found.told
    # The pattern is a formula: its slopes are known, and the noise of the repeats is not in them.
    x, y = found.images.xy.T
    h = 1e-5
    exact = (closed_form.relief(x + h, y) - closed_form.relief(x - h, y)) / (2 * h)
    square = np.mean(found.images.gradient[:, 0] ** 2)
    assert square == pytest.approx(np.mean(exact**2), rel=0.01)


def test_the_squared_slopes_of_noisy_repeats_are_those_of_the_pattern(tmp_path: Path) -> None:
    """Two repeats with a fifth of the slopes' variance as noise, instead of ten."""
    case, history = own_case(tmp_path), closed_form.history()
    clean = np.mean(expected_surface(case, Settings(), history).images.gradient ** 2)
    rng = np.random.default_rng(5)
    row, col = np.indices(closed_form.SHAPE, dtype=float)
    x, y = ((a - o) * PIXEL for a, o in zip((row, col), closed_form.ORIGIN, strict=True))
    sigma = np.sqrt(0.25 * clean / SLOPE_GAIN * 2) * PIXEL
    repeats = closed_form.relief(x, y) + sigma * rng.standard_normal((2, *closed_form.SHAPE))
    np.save(tmp_path / "repeats.npy", (repeats / case.images.level_um).astype(np.float32))
    noisy = case.model_copy(
        update={"images": case.images.model_copy(update={"repeats": "repeats.npy"})}
    )
    found = expected_surface(noisy, Settings(), history)
    assert "% of the squared slopes are noise" in found.told
    assert np.mean(found.images.gradient**2) == pytest.approx(clean, rel=0.05)


def test_a_surface_with_flats_can_be_handed_to_another_process(tmp_path: Path) -> None:
    case, history = own_case(tmp_path), closed_form.history()
    levels = np.random.default_rng(2).normal(size=(3, *closed_form.SHAPE)).astype(np.float32)
    tifffile.imwrite(tmp_path / "flats.tif", levels, photometric="minisblack")
    images = case.images.model_copy(update={"flats": "flats.tif"})
    found = expected_surface(case.model_copy(update={"images": images}), Settings(), history)
    handed = pickle.loads(pickle.dumps(found))
    assert found.experiment.flats is not None
    for here, there in zip(found.experiment.flats, handed.experiment.flats, strict=True):
        assert np.array_equal(here, there)


def test_without_repeats_a_virtual_face_is_taken(tmp_path: Path) -> None:
    case = own_case(tmp_path)
    (tmp_path / "repeats.tif").unlink()
    history = closed_form.history()
    settings = Settings(microscope=Microscope(repeats=7))
    found = expected_surface(case, settings, history)
    assert "no repeats yet" in found.told and found.images.n_reference == 7
    assert found.images.sigma == case.images.gamma_f
    bounds = found.images.bounds
    assert found.images.xy[:, 0].min() >= bounds[0] and found.images.xy[:, 1].max() <= bounds[3]
    bare = Settings(face=Face(dots_per_um2=0.0, roughness_nm=0.0))
    assert np.abs(expected_surface(case, bare, history).images.gradient).max() < 1e-12


def test_repeats_that_are_there_and_cannot_be_used_are_refused(tmp_path: Path) -> None:
    case = own_case(tmp_path)
    (tmp_path / "repeats.tif").write_bytes(b"no image")
    with pytest.raises(InputError, match="images.repeats"):
        expected_surface(case, Settings(), closed_form.history())

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tifffile

from driver.case.model import Case, load_case
from driver.common.errors import InputError
from driver.experiment.reading import Experiment, heights, origin, read_experiment
from driver.forward import build
from driver.forward.geometry import boundary_traces
from driver.results.hdf5 import read_hdf5
from driver.virtual.settings import Face, Microscope, Virtual
from driver.virtual.truth import Course, pull, stage_program
from driver.virtual.writing import correlated, record
from tools import closed_form

CASE = closed_form.small_case()
SMALL = Microscope(repeats=4, flats=6)


@pytest.fixture(scope="module")
def course() -> Course:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(build, "find_adapter", lambda name, profile: closed_form.ClosedFormSolver())
        stretch = {"elongation_1": 0.03, "elongation_2": 0.025}
        return pull(CASE, stage_program([(3, 1)]), stretch)


def made(folder: Path, course: Course, seed: int, scope: Microscope = SMALL) -> Experiment:
    folder.mkdir()
    return read_experiment(load_case(record(folder, CASE, course, seed, Virtual(microscope=scope))))


def quiet(folder: Path, course: Course, **settings: object) -> Case:
    """A case without noise, whose repeats are all alike: no experiment would be."""
    folder.mkdir()
    scope = Microscope(repeats=4, flats=6, noise_nm=0.0).model_copy(update=settings)
    return load_case(record(folder, CASE, course, 1, Virtual(microscope=scope)))


def taken(case: Case, name: str) -> np.ndarray:
    """Heights [µm] of a stack of a case."""
    return heights(case.images, tifffile.imread(case.path(f"{name}.tif")).astype(float))


def test_relief_stage_and_noise_do_not_depend_on_what_happens(
    tmp_path: Path, course: Course
) -> None:
    """Image 0, the repeats and the flats are the same with and without an effect."""
    pulled = made(tmp_path / "a", course, 1)
    still = made(tmp_path / "b", replace(course, motion=0 * course.motion), 1)
    other = made(tmp_path / "c", course, 2)
    for name in ("repeats", "flats"):
        here, there, elsewhere = (np.array(list(getattr(x, name))) for x in (pulled, still, other))
        np.testing.assert_array_equal(here, there)
        assert (here != elsewhere).mean() > 0.5
    np.testing.assert_array_equal(pulled.frames[0], still.frames[0])
    # A motion of a quarter of a pixel changes some levels of 6.5 nm.
    assert (pulled.frames[-1] != still.frames[-1]).mean() > 0.05


def test_a_virtual_test_has_no_wrong_loads(tmp_path: Path, course: Course) -> None:
    stated = CASE.model_copy(update={"loads": CASE.loads.model_copy(update={"left_out": (2, 99)})})
    tmp_path.joinpath("a").mkdir()
    path = record(tmp_path / "a", stated, course, 1, Virtual(microscope=SMALL))
    assert load_case(path).loads.left_out == () and len(read_experiment(load_case(path)).force)


def test_a_part_of_a_grain_that_differs_is_no_grain_of_the_case(
    tmp_path: Path, course: Course
) -> None:
    """Parameters of the truth are those of the case, whose boundary has no number."""
    turned = course.orientations
    parted = replace(course, orientations=np.concatenate([turned, turned[1:]]))
    record(tmp_path, CASE, parted, 1, Virtual(microscope=SMALL))
    written = json.loads((tmp_path / "truth.json").read_text(encoding="utf-8"))
    assert written["values"]["boundary_shift"]["unit"] == "µm"


def test_labels_are_written_anew_as_the_images_lie(tmp_path: Path, course: Course) -> None:
    """The grains of the truth, on pixels that the case places half a pixel off at most."""
    plane = {"labels": "elsewhere.png", "boundary_point_um": None, "boundary_normal": None}
    specimen = CASE.specimen.model_copy(update=plane | {"labels_pixel_nm": 7.0})
    stated = CASE.model_copy(update={"specimen": specimen})
    case = load_case(record(tmp_path, stated, course, 1, Virtual(microscope=SMALL)))
    assert case.specimen.labels_pixel_nm is None
    (drawn,), found = boundary_traces(CASE), boundary_traces(case).reshape(-1, 2)
    slope = np.diff(drawn[:, 1])[0] / np.diff(drawn[:, 0])[0]
    expected = drawn[0, 1] + slope * (found[:, 0] - drawn[0, 0])
    assert np.ptp(found[:, 0]) == pytest.approx(CASE.specimen.width)
    np.testing.assert_allclose(found[:, 1], expected, atol=1.2 * case.images.pixel_um)
    assert not (tmp_path / "elsewhere.png").exists()


def test_an_experiment_of_the_files_of_an_instrument_has_levels_of_its_own(
    tmp_path: Path, course: Course
) -> None:
    """Trenches of its images are at level 0, and nothing is shifted by the stage of a scan."""
    scans = {"frames": "a_*.x3p", "height_per_level_nm": 1.0, "off_surface_level": "none"}
    images = CASE.images.model_copy(update=scans | {"height_offset_nm": -4e6})
    stated = CASE.model_copy(update={"images": images})
    path = record(tmp_path, stated, course, 1, Virtual(microscope=SMALL))
    case = load_case(path)
    assert case.images.off_surface_level == 0.0 and case.images.height_offset_nm == 0.0
    experiment = read_experiment(case)
    off = tifffile.imread(tmp_path / "images.tif")[0] == 0
    assert off.any()
    np.testing.assert_array_equal(np.isnan(experiment.frames[0]), off)


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_the_images_read_back_are_the_truth_to_half_a_level(
    tmp_path: Path, course: Course, bits: int
) -> None:
    """The repeats are relief plus pattern, and the trench has no height."""
    case = quiet(tmp_path / "a", course, bits=bits)
    repeats, truth = taken(case, "repeats"), read_hdf5(tmp_path / "a" / "truth.h5")
    on_face = np.abs(truth["x"]) <= CASE.specimen.width / 2
    level = case.images.level_um
    ground = {8: 100, 16: 25600, 32: 0}[bits] * level
    wrong = repeats - ground - truth["relief"] - truth["pattern"]
    assert np.abs(wrong[:, on_face]).max() <= (0.5 * level if bits < 32 else 1e-8) * (1 + 1e-6)
    off = repeats[:, ~on_face]
    assert off.size and np.isnan(off).all()


def test_slip_steps_are_added_to_the_images_and_to_nothing_else(
    tmp_path: Path, course: Course
) -> None:
    slip = np.zeros((len(course.motion), len(course.mesh.cells), 24))
    slip[-1, :, 3] = 0.01
    stacks: list[dict[str, np.ndarray]] = []
    for name, spacing in (("smooth", 0.0), ("stepped", 0.5)):
        (tmp_path / name).mkdir()
        scope = Microscope(repeats=4, flats=6, noise_nm=0.0, bits=32)
        settings = Virtual(microscope=scope, face=Face(slip_spacing_um=spacing))
        case = load_case(record(tmp_path / name, CASE, replace(course, slip=slip), 1, settings))
        stacks.append({stack: taken(case, stack) for stack in ("images", "repeats", "flats")})
    smooth, stepped = stacks
    for name in ("repeats", "flats"):
        np.testing.assert_array_equal(smooth[name], stepped[name])
    np.testing.assert_array_equal(smooth["images"][:-1], stepped["images"][:-1])
    steps = np.nan_to_num(stepped["images"][-1] - smooth["images"][-1])
    # Half of γ h at the most, for the slip direction is a unit vector.
    assert 2e-4 < np.abs(steps).max() <= 0.01 * 0.5 / 2 * 1.01


def test_the_origin_is_off_by_its_error_and_that_of_the_truth(
    tmp_path: Path, course: Course
) -> None:
    shifted = replace(course, values={**course.values, "origin_X": 0.05, "origin_Y": -0.02})
    places = []
    for name, moved in (("a", course), ("b", shifted)):
        case = quiet(tmp_path / name, moved)
        truth = read_hdf5(tmp_path / name / "truth.h5")
        row, column = origin(case.images, truth["x"].shape)
        pixel = case.images.pixel_um
        stated = (0 - row) * pixel, (0 - column) * pixel
        places.append([truth["x"][0, 0] - stated[0], truth["y"][0, 0] - stated[1]])
    assert np.abs(places[0]).max() <= 0.5 * CASE.images.pixel_um
    np.testing.assert_allclose(np.subtract(places[1], places[0]), [0.05, -0.02], atol=1e-12)


def test_a_pattern_that_has_changed_since_the_flats_stays_in_the_images(
    tmp_path: Path, course: Course
) -> None:
    changed = replace(course, values={**course.values, "fixed_pattern": 0.5})
    as_flats, later = (
        quiet(tmp_path / name, which, bits=32) for name, which in (("a", course), ("b", changed))
    )
    np.testing.assert_array_equal(taken(as_flats, "flats"), taken(later, "flats"))
    pattern = read_hdf5(tmp_path / "a" / "truth.h5")["pattern"]
    for name in ("images", "repeats"):
        added = taken(later, name) - taken(as_flats, name)
        seen = np.isfinite(added)
        every = np.broadcast_to(0.5 * pattern, added.shape)
        np.testing.assert_allclose(added[seen], every[seen], atol=1e-7)


def test_the_noise_grows_along_the_columns_with_the_rms_stated(
    tmp_path: Path, course: Course
) -> None:
    scope = Microscope(repeats=200, flats=6, noise_nm=9.0, noise_ratio=3.0, bits=32)
    case = load_case(record(tmp_path, CASE, course, 1, Virtual(microscope=scope)))
    spread = taken(case, "repeats").std(axis=0, ddof=1)
    by_column = np.sqrt(np.nanmean(spread**2, axis=0))
    # 200 repeats of about 40 pixels: 0.8 %
    assert by_column[-1] / by_column[0] == pytest.approx(3.0, rel=0.05)
    assert np.sqrt(np.mean(by_column**2)) == pytest.approx(0.009, rel=0.02)


def test_load_noise_has_the_size_and_the_correlation_that_the_case_states() -> None:
    noise = correlated(np.random.default_rng(0), 40000, 0.8)
    assert noise.std() == pytest.approx(1.0, abs=0.05)
    assert np.corrcoef(noise[1:], noise[:-1])[0, 1] == pytest.approx(0.8, abs=0.02)


def test_heights_beyond_the_levels_are_one_sentence(tmp_path: Path, course: Course) -> None:
    high = replace(course, motion=course.motion + [0.0, 0.0, 2.0])
    with pytest.raises(InputError, match=r"^microscope.bits: levels: found .* expected 1 to 255"):
        made(tmp_path / "a", high, 1)

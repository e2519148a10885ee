from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import h5py
import imagecodecs
import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray

from driver.case.images import Axis, Images
from driver.case.model import default_case, load_case, write_case
from driver.experiment.reading import (
    arrange,
    as_in_files,
    heights,
    origin,
    read_experiment,
    refuse_absent_images,
)
from driver.experiment.stack_checks import ExperimentError

Arrangement = tuple[Axis, Axis, Literal["+Z", "-Z"]]
RIGHT_HANDED: list[Arrangement] = [
    ("+X", "+Y", "+Z"), ("-X", "-Y", "+Z"), ("+Y", "-X", "+Z"), ("-Y", "+X", "+Z"),
    ("+Y", "+X", "-Z"), ("-X", "+Y", "-Z"), ("+X", "-Y", "-Z"), ("-Y", "-X", "-Z"),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A case of two images with flats, repeats and a mask, no two pixels alike."""
    levels = np.arange(2 * 6 * 10, dtype=np.uint8).reshape(2, 6, 10)
    tifffile.imwrite(tmp_path / "images.tif", levels, photometric="minisblack")
    tifffile.imwrite(tmp_path / "flats.tif", levels[:, ::-1].copy(), photometric="minisblack")
    repeats = np.stack([levels[0] + k for k in range(3)])
    tifffile.imwrite(tmp_path / "repeats.tif", repeats, photometric="minisblack")
    tifffile.imwrite(
        tmp_path / "mask.tif", (levels[0] > 9).astype(np.uint8), photometric="minisblack"
    )
    (tmp_path / "history.csv").write_text(
        "time_s,stage_um,image,force_N\n0,0,0,1.5\n10,5,,\n40,5,1,100\n"
    )
    case = default_case()
    images = case.images.model_copy(update={"mask": "mask.tif", "origin_pixel": (2.5, 1.0)})
    write_case(case.model_copy(update={"images": images}), tmp_path / "case.toml")
    return tmp_path


def test_an_experiment_is_read_in_internal_units(folder: Path) -> None:
    experiment = read_experiment(load_case(folder / "case.toml"))
    assert experiment.frames.shape == (2, 6, 10) and experiment.frames[0].dtype == np.float64
    # Level 60 of 6.5 nm; 100 N on 3 mm² is 231 µN on 4√3 µm².
    assert experiment.frames[1][0, 0] == pytest.approx(0.390)
    assert experiment.force[1] == pytest.approx(100 * 4 * 3**0.5 / 3)
    assert experiment.flats is not None and experiment.flats[0][0, 0] == pytest.approx(0.325)
    assert experiment.repeats is not None and len(experiment.repeats) == 3
    assert experiment.mask is not None and experiment.mask.sum() == 50
    assert experiment.origin == (2.5, 1.0)
    assert (experiment.gamma_f, experiment.gamma_F) == pytest.approx((0.009, 5.97))


@pytest.mark.parametrize("axes", RIGHT_HANDED)
def test_what_is_written_as_the_files_lie_is_read_as_it_was(
    axes: Arrangement,
) -> None:
    rows, columns, up = axes
    images = Images(frames="images.tif", rows_along=rows, columns_along=columns, heights=up)
    stack = np.arange(60).reshape(1, 6, 10)
    np.testing.assert_array_equal(arrange(images, as_in_files(images, stack)), stack)


@pytest.mark.parametrize("axes", RIGHT_HANDED)
def test_every_right_handed_arrangement_is_turned_into_the_specimen_frame(
    axes: Arrangement,
) -> None:
    """Heights of a tilted plane, written as the arrangement says, come back as that plane."""
    x, y = np.meshgrid(np.arange(-2.0, 4.0), np.arange(-1.0, 9.0), indexing="ij")
    z = 100.0 + 3.0 * x + 0.25 * y
    rows, columns, up = axes
    stored = z if rows[1] == "X" else z.T
    row, column = (2.0, 1.0) if rows[1] == "X" else (1.0, 2.0)
    if rows[0] == "-":
        stored, row = stored[::-1], stored.shape[0] - 1 - row
    if columns[0] == "-":
        stored, column = stored[:, ::-1], stored.shape[1] - 1 - column
    stored = stored if up == "+Z" else -stored
    images = Images(
        frames="images.tif", height_per_level_nm=1000.0, origin_pixel=(row, column),
        rows_along=rows, columns_along=columns, heights=up,
    )  # fmt: skip
    np.testing.assert_array_equal(heights(images, stored[None])[0], z)
    assert origin(images, stored.shape) == (2.0, 1.0)


def test_arranging_never_mirrors() -> None:
    """Of the eight arrangements of a square picture, those seen from outside are its turns."""
    picture = np.arange(9.0).reshape(1, 3, 3)
    turns = {np.rot90(picture[0], k).tobytes() for k in range(4)}
    arranged = {
        arrange(
            Images(frames="images.tif", rows_along=rows, columns_along=columns), picture
        ).tobytes()
        for rows, columns, up in RIGHT_HANDED
        if up == "+Z"
    }
    assert arranged == turns


def test_another_number_of_frames_than_of_images_is_refused(folder: Path) -> None:
    with (folder / "history.csv").open("a") as file:
        file.write("50,10,2,120\n")
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(folder / "case.toml"))
    assert str(error.value) == (
        f"{folder / 'images.tif'}: images.frames: found 2 frames, "
        "expected 3, the images of history.csv"
    )


@pytest.mark.parametrize(
    ("left_out", "told"),
    [
        ([1, 2, 7], "loads.left_out: found 2, 7, expected numbers from 0 to 1, as {} has them"),
        ([1], "loads.left_out: found 1 of the 2 loads of {}, expected at least 2 that stay"),
    ],
)
def test_loads_that_cannot_be_left_out_are_named(
    folder: Path, left_out: list[int], told: str
) -> None:
    case, path = load_case(folder / "case.toml"), folder / "history.csv"
    loads = case.loads.model_copy(update={"left_out": tuple(left_out)})
    with pytest.raises(ExperimentError) as error:
        read_experiment(case.model_copy(update={"loads": loads}))
    assert str(error.value) == told.format(path)


@pytest.mark.parametrize("name", ["flats", "repeats", "mask"])
def test_a_stack_of_another_size_is_refused(folder: Path, name: str) -> None:
    tifffile.imwrite(
        folder / f"{name}.tif", np.ones((2, 6, 9), dtype=np.uint8), photometric="minisblack"
    )
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(folder / "case.toml"))
    assert str(error.value) == (
        f"{folder / name}.tif: images.{name}: found 6 × 9 px, expected 6 × 10 px as the frames"
    )


def test_a_mask_of_several_images_is_refused(folder: Path) -> None:
    tifffile.imwrite(
        folder / "mask.tif", np.ones((2, 6, 10), dtype=np.uint8), photometric="minisblack"
    )
    with pytest.raises(ExperimentError, match="images.mask: found 2 images, expected one"):
        read_experiment(load_case(folder / "case.toml"))


def test_heights_are_scale_and_offset_of_the_levels_without_any_loss(
    folder: Path, tmp_path: Path
) -> None:
    """16 bit and doubles, compared with the formula in exact arithmetic on the levels."""
    rng = np.random.default_rng(1)
    for dtype, name in (("uint16", "a.tif"), ("uint16", "a.png"), ("float64", "a.h5")):
        levels = rng.integers(1, 65535, size=(2, 6, 10)).astype(dtype)
        if name == "a.h5":
            levels = rng.normal(size=levels.shape)
            with h5py.File(tmp_path / name, "w") as file:
                file["scan/heights"] = levels
            path = "a.h5:/scan/heights"
        elif name == "a.png":
            for t in range(2):
                (tmp_path / f"a{t}.png").write_bytes(imagecodecs.png_encode(levels[t]))
            path = "a*.png"
        else:
            tifffile.imwrite(tmp_path / name, levels, photometric="minisblack")
            path = name
        case = load_case(folder / "case.toml")
        changed = {
            "frames": path, "flats": None, "repeats": None, "mask": None,
            "height_per_level_nm": 0.5, "height_offset_nm": -3000.0,
        }  # fmt: skip
        case = case.model_copy(update={"images": case.images.model_copy(update=changed)})
        np.testing.assert_allclose(
            np.array(read_experiment(case).frames),
            (0.5 * levels - 3000.0) / 1000.0,
            rtol=0,
            atol=4e-15,
        )


def test_pixels_without_a_height_are_no_numbers_whatever_the_offset() -> None:
    levels = np.array([[[0.0, 5.0, np.nan, np.inf, 7.0]]])
    one = Images(frames="images.tif", height_per_level_nm=1000.0, height_offset_nm=-5000.0)
    np.testing.assert_array_equal(heights(one, levels), [[[np.nan, 0, np.nan, np.nan, 2]]])
    two = one.model_copy(update={"off_surface_level": 7.0})
    np.testing.assert_array_equal(heights(two, levels), [[[-5, 0, np.nan, np.nan, np.nan]]])
    none = one.model_copy(update={"off_surface_level": "none", "heights": "-Z"})
    np.testing.assert_array_equal(heights(none, levels), [[[5, 0, np.nan, np.nan, -2]]])


SURFACE = np.arange(1, 61, dtype=np.uint8).reshape(6, 10)


def numbered(folder: Path, numbers: tuple[int, ...]) -> str:
    for number in numbers:
        tifffile.imwrite(folder / f"f_{number:03d}.tif", SURFACE + number, photometric="minisblack")
    return "f_*.tif"


def stored(folder: Path, name: str, array: NDArray[np.generic], **options: Any) -> str:
    tifffile.imwrite(folder / name, array, **{"photometric": "minisblack", **options})
    return name


def cut(folder: Path) -> str:
    stored(folder, "cut.tif", np.stack([SURFACE] * 2), metadata=None)
    content = (folder / "cut.tif").read_bytes()
    (folder / "cut.tif").write_bytes(content[:150])
    return "cut.tif"


def dataset(folder: Path) -> str:
    with h5py.File(folder / "a.h5", "w") as file:
        file["scan/heights"] = np.stack([SURFACE] * 2)
    return "a.h5:/scan/levels"


BAD: dict[str, tuple[str, Callable[[Path], str], str]] = {
    "gap": ("frames", lambda f: numbered(f, (1, 2, 4, 5)),
            "found 4 frames (f_004.tif follows f_002.tif), expected 2, the images of history.csv"),
    "absent": ("frames", lambda f: "nothing/*.tif", "found no image, expected a file, a folder or"),
    "below a file": ("frames", lambda f: "images.tif/a.tif", "found no image, expected a file"),
    "long name": ("frames", lambda f: "a" * 300, "found “File name too long”, expected a file"),
    "zero in name": ("frames", lambda f: "a\0b", "found no image, expected a file"),
    "truncated": ("frames", cut, "expected a TIFF file that"),
    "no dataset": ("frames", dataset, 'found no dataset "/scan/levels", expected a.h5:NAME with '
                   "NAME one of /scan/heights"),
    "colours": ("flats", lambda f: stored(f, "rgb.tif", np.stack([SURFACE] * 3, axis=-1),
                                          photometric="rgb"),
                "found 3 colour channels (RGB), expected heights, one number a pixel"),
    "types": ("repeats", lambda f: stored(f, "r.tif", np.stack([SURFACE + k for k in (0, 1)])
                                          .astype(np.uint16)),
              "found levels of type uint16, expected uint8 as the frames"),
    "scales": ("repeats", lambda f: stored(f, "r.tif", np.stack([4 * SURFACE, 4 * SURFACE + 1])),
               "found heights that spread over 1.38e+03 nm, expected about 339 nm as in image 0"),
    "one repeat": ("repeats", lambda f: stored(f, "r.tif", SURFACE),
                   "found 1 frame, expected at least 2 (their scatter is the noise)"),
    "twice the same": ("repeats", lambda f: stored(f, "r.tif", np.stack([SURFACE] * 2)),
                       "found frame 1 with every pixel as in frame 0"),
    "constant": ("frames", lambda f: stored(f, "c.tif", np.stack([SURFACE, 0 * SURFACE + 7])),
                 "found level 7 at every pixel in frame 1, expected heights of a surface"),
    "all NaN": ("frames", lambda f: stored(f, "n.tif", np.full((2, 6, 10), np.nan, np.float32)),
                "found no pixel with a height in frame 0, expected heights of a surface"),
    "no height": ("frames", lambda f: stored(f, "h.tif", np.where(
        np.arange(120).reshape(2, 6, 10) == 70, -3.4e38, np.stack([SURFACE + k for k in (0, 1)])
        ).astype(np.float32)), "found level -3.4e+38 in frame 1, expected heights within 1e+06 nm"),
    "mask": ("mask", lambda f: stored(f, "m.tif", 0 * SURFACE),
             "found 0 at every pixel, expected another number where pixels are used"),
    "noise": ("noise_map", lambda f: stored(f, "o.tif", SURFACE - SURFACE.min()),
              "found 0 at row 0, column 0, expected a number above 0 at every pixel"),
    "a noise left out": ("noise_map", lambda f: stored(f, "o.tif", np.where(
        np.arange(60).reshape(6, 10) == 23, np.nan, 1.0).astype(np.float32)),
              "found nan at row 2, column 3, expected a number above 0 at every pixel"),
    "two noises": ("noise_map", lambda f: stored(f, "o.tif", np.stack([SURFACE + 1] * 2)),
                   "found 2 images, expected one"),
}  # fmt: skip


@pytest.mark.parametrize("what", BAD)
def test_bad_images_are_told_in_one_sentence_with_file_and_key(folder: Path, what: str) -> None:
    key, make, sentence = BAD[what]
    case = load_case(folder / "case.toml")
    name = make(folder)
    others = {"flats": None, "repeats": None, "mask": None}
    images = case.images.model_copy(update=others | {key: name})
    with pytest.raises(ExperimentError) as error:
        read_experiment(case.model_copy(update={"images": images}))
    (told,) = str(error.value).splitlines()
    assert f": images.{key}: found " in told and sentence in told
    assert told.startswith(str(folder / name.split(":")[0]))


def test_everything_that_is_wrong_is_told_at_once(folder: Path) -> None:
    for name in ("images.tif", "flats.tif", "repeats.tif", "mask.tif", "history.csv"):
        (folder / name).unlink()
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(folder / "case.toml"))
    told = str(error.value).splitlines()
    assert len(told) == 5
    for line, name in zip(told, ("history", "images", "flats", "repeats", "mask"), strict=True):
        assert f"{folder / name}." in line and "found no" in line


def test_images_that_are_not_named_or_not_there_are_told_at_once(tmp_path: Path) -> None:
    case = default_case().with_values_at(
        {"images.frames": None, "images.repeats": None, "images.flats": None}
    )
    with pytest.raises(ExperimentError) as error:
        refuse_absent_images(case)
    assert str(error.value).startswith("images.frames: found nothing")
    for name in ("a.npy", "b.npy"):
        np.save(tmp_path / name, np.zeros((2, 3, 4)))
    names = {"frames": "a.npy", "repeats": "b.npy", "flats": "gone_*.tif"}
    there = case.with_values_at({f"images.{key}": str(tmp_path / n) for key, n in names.items()})
    with pytest.raises(ExperimentError, match=r"gone_\*.tif: images.flats: found no image"):
        refuse_absent_images(there)
    refuse_absent_images(there.with_values_at({"images.flats": None}))

import numpy as np
import pytest
import tifffile

from driver.case import default_case, load_case, write_case
from driver.case_tables import Images
from driver.experiment import ExperimentError, arrange, heights, origin, read_experiment

RIGHT_HANDED = [
    ("+X", "+Y", "+Z"), ("-X", "-Y", "+Z"), ("+Y", "-X", "+Z"), ("-Y", "+X", "+Z"),
    ("+Y", "+X", "-Z"), ("-X", "+Y", "-Z"), ("+X", "-Y", "-Z"), ("-Y", "-X", "-Z"),
]  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    """A case of two images with flats, repeats and a mask, no two pixels alike."""
    levels = np.arange(2 * 6 * 10, dtype=np.uint8).reshape(2, 6, 10)
    tifffile.imwrite(tmp_path / "images.tif", levels, photometric="minisblack")
    tifffile.imwrite(tmp_path / "flats.tif", levels[:, ::-1].copy(), photometric="minisblack")
    tifffile.imwrite(tmp_path / "repeats.tif", np.stack([levels[0]] * 3), photometric="minisblack")
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


def test_an_experiment_is_read_in_internal_units(folder):
    experiment = read_experiment(load_case(folder / "case.toml"))
    assert experiment.frames.shape == (2, 6, 10) and experiment.frames.dtype == np.float64
    # Level 60 of 6.5 nm; 100 N on 3 mm² is 231 µN on 4√3 µm².
    assert experiment.frames[1, 0, 0] == pytest.approx(0.390)
    assert experiment.force[1] == pytest.approx(100 * 4 * 3**0.5 / 3)
    assert experiment.flats is not None and experiment.flats[0, 0, 0] == pytest.approx(0.325)
    assert experiment.repeats is not None and len(experiment.repeats) == 3
    assert experiment.mask is not None and experiment.mask.sum() == 50
    assert experiment.origin == (2.5, 1.0)
    assert (experiment.gamma_f, experiment.gamma_F) == pytest.approx((0.009, 5.97))


@pytest.mark.parametrize("axes", RIGHT_HANDED)
def test_every_right_handed_arrangement_is_turned_into_the_specimen_frame(axes):
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
        frames="", height_per_level_nm=1000.0, origin_pixel=(row, column),
        rows_along=rows, columns_along=columns, heights=up,
    )  # fmt: skip
    np.testing.assert_array_equal(heights(images, stored[None])[0], z)
    assert origin(images, stored.shape) == (2.0, 1.0)


def test_arranging_never_mirrors():
    """Of the eight arrangements of a square picture, those seen from outside are its turns."""
    picture = np.arange(9.0).reshape(1, 3, 3)
    turns = {np.rot90(picture[0], k).tobytes() for k in range(4)}
    arranged = {
        arrange(Images(frames="", rows_along=rows, columns_along=columns), picture).tobytes()
        for rows, columns, up in RIGHT_HANDED
        if up == "+Z"
    }
    assert arranged == turns


def test_another_number_of_frames_than_of_images_is_refused(folder):
    with (folder / "history.csv").open("a") as file:
        file.write("50,10,2,120\n")
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(folder / "case.toml"))
    assert str(error.value) == (
        f"{folder / 'images.tif'}: images.frames: found 2 frames, "
        "expected 3, the images of history.csv"
    )


@pytest.mark.parametrize("name", ["flats", "repeats", "mask"])
def test_a_stack_of_another_size_is_refused(folder, name):
    tifffile.imwrite(
        folder / f"{name}.tif", np.ones((1, 6, 9), dtype=np.uint8), photometric="minisblack"
    )
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(folder / "case.toml"))
    assert str(error.value) == (
        f"{folder / name}.tif: images.{name}: found 6 × 9 px, expected 6 × 10 px as the frames"
    )


def test_a_mask_of_several_images_is_refused(folder):
    tifffile.imwrite(
        folder / "mask.tif", np.ones((2, 6, 10), dtype=np.uint8), photometric="minisblack"
    )
    with pytest.raises(ExperimentError, match="images.mask: found 2 images, expected one"):
        read_experiment(load_case(folder / "case.toml"))

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image, PngImagePlugin

from driver.case.model import default_case, load_case, write_case
from driver.experiment.reading import read_experiment
from driver.experiment.stack_checks import ExperimentError


def case_of(folder: Path, stack: np.ndarray, **images: Any) -> Path:
    """A case of some frames, the first of which are its repeats, too."""
    np.save(folder / "images.npy", stack)
    rng = np.random.default_rng(8)
    noise = rng.integers(0, 2, size=(2, *stack.shape[1:])).astype(stack.dtype)
    kept = np.abs(stack[0].astype(float)) < 5000
    np.save(folder / "repeats.npy", np.where(kept, stack[0] + noise, stack[0]))
    rows = [f"{t},{t},{t},1" for t in range(len(stack))]
    (folder / "history.csv").write_text("\n".join(["time_s,stage_um,image,force_N", *rows]))
    stated = {"frames": "images.npy", "repeats": "repeats.npy", "flats": None} | images
    case = default_case()
    case = case.model_copy(update={"images": case.images.model_copy(update=stated)})
    write_case(case, folder / "case.toml")
    return folder / "case.toml"


@pytest.mark.parametrize(
    ("level", "dtype", "told"),
    [
        (-9999.0, np.float32, "-9999"),
        (-(2.0**15), np.int16, "-32768"),
        (float(np.finfo(np.float32).max), np.float32, "3.4028234663852886e+38"),
        (0.0, np.uint16, "0"),
        (0.0, np.float32, "0"),
    ],
)
def test_a_level_that_marks_pixels_without_a_height_is_named_with_its_key(
    tmp_path: Path, level: float, dtype: type, told: str
) -> None:
    frames = 1000 + np.random.default_rng(9).normal(0, 50, (3, 30, 40))
    frames[1, :3] = level
    path = case_of(tmp_path, frames.astype(dtype), off_surface_level="none")
    with pytest.raises(ExperimentError) as error:
        read_experiment(load_case(path))
    message = str(error.value)
    assert f"found level {told} at 120 pixels (0.1 of all) of frame 1, away from all" in message
    assert f"images.off_surface_level = {told} if it marks pixels without one" in message
    case = load_case(path).with_values_at({"images.off_surface_level": float(told)})
    assert np.isnan(read_experiment(case).frames[1]).sum() == 120


def test_what_belongs_to_the_surface_is_no_mark(tmp_path: Path) -> None:
    """Heights that are cut at the end of a type, single spikes, and two levels of a quiet flat."""
    frames = 200 + np.random.default_rng(10).normal(0, 40, (3, 30, 40))
    frames[0, 4, 5:9] = 0
    path = case_of(tmp_path, np.clip(frames, 1, 255).astype(np.uint8))
    assert read_experiment(load_case(path)).clipped > 100
    two = np.random.default_rng(11).integers(100, 102, (3, 60, 80)).astype(np.uint8)
    two[0, 5:8, 5:10] = 255  # a grain of dust
    assert len(read_experiment(load_case(case_of(tmp_path, two))).frames) == 3


def test_another_pixel_size_than_that_of_the_files_is_remarked(tmp_path: Path) -> None:
    frames = np.random.default_rng(12).integers(50, 90, (3, 30, 40)).astype(np.uint8)
    path = case_of(tmp_path, frames, frames="images.tif")
    for size, remarked in ((0.1, True), (0.1099, False)):
        tifffile.imwrite(
            tmp_path / "images.tif", frames, imagej=True, resolution=(1 / size, 1 / size),
            metadata={"unit": "um", "axes": "TYX"},
        )  # fmt: skip
        remarks = read_experiment(load_case(path)).remarks
        told = f"{tmp_path}/images.tif: images.frames: found pixels of 100 nm in the file, " \
            "expected the 110 of images.pixel_size_nm, which are used"  # fmt: skip
        assert remarks == ((told,) if remarked else ())


def test_one_image_for_all_stops_is_refused_and_a_copy_is_remarked(tmp_path: Path) -> None:
    frames = np.random.default_rng(13).integers(50, 90, (6, 30, 40)).astype(np.uint8)
    path = case_of(tmp_path, np.repeat(frames[:1], 6, axis=0))
    with pytest.raises(ExperimentError, match=r"found the levels of frame 0 in all 6 frames, expe"):
        read_experiment(load_case(path))
    frames[4] = frames[1]
    (remark,) = read_experiment(load_case(case_of(tmp_path, frames))).remarks
    assert "images.frames: found every level of frame 1 in frame 4, expected an image" in remark


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_contrast_that_was_chosen_for_each_image_is_refused(tmp_path: Path, dtype: type) -> None:
    """The same surface, noise of a tenth of its relief, 557 px as a camera has."""
    rng = np.random.default_rng(14)
    relief = rng.normal(0.0, 20.0, (557, 557))
    largest = np.iinfo(dtype).max
    heights = [relief + rng.normal(0.0, 2.0, relief.shape) for _ in range(6)]
    stretched = [np.rint((h - h.min()) / np.ptp(h) * largest) for h in heights]
    path = case_of(tmp_path, np.array(stretched, dtype), off_surface_level="none")
    told = (
        rf"found levels from 0 to {largest} in each frame, whose relief changes by .* expected one"
    )
    with pytest.raises(ExperimentError, match=told):
        read_experiment(load_case(path))
    # A trench at 0 and spikes at the limit end all frames of one scale alike, too.
    plain = [np.clip(0.5 * largest + h * largest / 400, 1, largest - 1) for h in heights]
    for frame in plain:
        frame[:9], frame[60, 60:64] = 0, largest
    path = case_of(tmp_path, np.array(plain, dtype))
    assert len(read_experiment(load_case(path)).frames) == 6


def test_contrast_of_each_image_does_no_harm_where_the_file_tells_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(14)
    relief = rng.normal(0.0, 20.0, (60, 80))
    heights = [relief + rng.normal(0.0, 2.0, relief.shape) for _ in range(5)]
    case = load_case(case_of(tmp_path, np.array(heights), off_surface_level="none"))
    for t, frame in enumerate(heights):
        low, high = frame.min(), frame.max()
        texts = PngImagePlugin.PngInfo()
        for key, text in {"ZMin": f"{low:.9g}", "ZMax": f"{high:.9g}", "ZUnit": "nm"}.items():
            texts.add_text(f"Gwy::{key}", text)
        levels = np.rint((frame - low) / (high - low) * 65535).astype(np.uint16)
        Image.fromarray(levels).save(tmp_path / f"frame_{t}.png", pnginfo=texts)
    pngs = {"images.frames": "frame_*.png", "images.repeats": "frame_[01].png"}
    with pytest.raises(ExperimentError, match="expected height_per_level_nm = 1 for files that"):
        read_experiment(case.with_values_at(pngs))
    experiment = read_experiment(case.with_values_at(pngs | {"images.height_per_level_nm": 1.0}))
    for seen, frame in zip(experiment.frames, heights, strict=True):
        assert 1e3 * seen == pytest.approx(frame, abs=2e-3)  # half a level of 150 nm is 1e-3


def test_repeats_that_are_frames_of_the_test_are_told(tmp_path: Path) -> None:
    frames = 1000 + np.random.default_rng(12).normal(0, 50, (4, 30, 40))
    path = case_of(tmp_path, frames.astype(np.float32))
    assert read_experiment(load_case(path)).remarks == ()
    # The first image may be one of the unloaded surface; those after the stage has moved are not.
    np.save(tmp_path / "repeats.npy", frames[[0, 2, 3]].astype(np.float32))
    remarks = read_experiment(load_case(path)).remarks
    assert [remark.split("found ")[1].split(",")[0] for remark in remarks] == [
        "every level of frame 2 of images.frames in repeat 1",
        "every level of frame 3 of images.frames in repeat 2",
    ]

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile

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
    two = np.random.default_rng(11).integers(100, 102, (3, 30, 40)).astype(np.uint8)
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

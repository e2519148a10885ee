"""What the stage keeps of each image."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import tifffile
from numpy.typing import NDArray
from scipy import ndimage

from driver.case.model import load_case, write_case
from driver.common.splines.images import spline_images
from driver.workflow.engine import StageContext
from driver.workflow.measure_stage import measure_numbers

ALPHA = Path(__file__).parents[3] / "examples" / "alpha" / "case.toml"
ROWS, COLUMNS = 120, 240  # of which the face has 40 × 120
FEW, MANY = 60, 240  # images; what is at work together has its size with the few


def write_images(folder: Path, n_images: int) -> None:
    """Images of 8 bits that drift by a pixel and stretch by a part of one, and their history."""
    rng = np.random.default_rng(5)
    relief = ndimage.gaussian_filter(rng.normal(size=(ROWS, COLUMNS)), 2.0)
    spline = spline_images(45.0 * relief[None] / relief.std(), 1.0, (0.0, 0.0))
    row, column = np.indices(relief.shape, dtype=np.float64)

    def levels(height: float, row: NDArray[np.float64], column: NDArray[np.float64]) -> object:
        heights = height * spline.value(0, row, column) + 9.0 * rng.normal(size=row.shape)
        return np.clip(np.rint(128 + heights / 6.5), 1, 255).astype(np.uint8)

    moved = []
    for t in range(n_images):
        stretch = 0.5 * t / n_images * column / COLUMNS
        moved.append(levels(1.0, row - np.sin(t / 7), column - np.cos(t / 11) - stretch))
    still = {"repeats": (1.0, 10), "flats": (0.0, 20)}
    tifffile.imwrite(folder / "images.tif", np.array(moved))
    for name, (height, n) in still.items():
        stack = np.array([levels(height, row, column) for _ in range(n)])
        tifffile.imwrite(folder / f"{name}.tif", stack)
    lines = [f"{40 * t},{t / 10},{t},{100 + t}" for t in range(n_images)]
    (folder / "history.csv").write_text("\n".join(["time_s,stage_um,image,force_N", *lines]))


def peak_of_measure(folder: Path, n_images: int) -> int:
    """Largest memory that the stage asks for at a time [bytes]."""
    folder.mkdir()
    write_images(folder, n_images)
    stated = {"images.pixel_size_nm": 100.0, "images.origin_pixel": (60.0, 60.0)}
    write_case(load_case(ALPHA).with_values_at(stated), folder / "case.toml")
    context = StageContext(load_case(folder / "case.toml"), folder, folder)
    tracemalloc.start()
    try:
        measure_numbers(context)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_an_image_takes_less_than_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # What is bounded whatever the number of images is small here, as so few images are.
    monkeypatch.setattr("driver.dic.surface_images._KEPT", 0)
    monkeypatch.setattr("driver.dic.covariance._BLOCK", 2**18)
    few, many = (peak_of_measure(tmp_path / str(n), n) for n in (FEW, MANY))
    each = (many - few) / (MANY - FEW) / (ROWS * COLUMNS)
    assert each < 1.0  # byte a pixel, which its file alone has; its spline would take 8

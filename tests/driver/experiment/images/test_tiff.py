"""TIFF files of other programs: Pillow writes what ImageJ, microscopes and scanners do."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tifffile
from PIL import Image, TiffImagePlugin

from driver.experiment.images.heightmaps import ImageError, load_stack

ORIENTATION, DESCRIPTION, X_RESOLUTION, Y_RESOLUTION = 274, 270, 282, 283


def levels(n: int = 1) -> np.ndarray:
    return np.random.default_rng(6).integers(0, 256, (n, 9, 11)).astype(np.uint8)


def save(path: Path, stack: np.ndarray, tags: dict[int, Any], **options: Any) -> None:
    """Pages of a TIFF file, the first with more tags."""
    directory = TiffImagePlugin.ImageFileDirectory_v2()
    for tag, value in tags.items():
        directory[tag] = value
    first, *others = [Image.fromarray(page) for page in stack]
    first.save(path, save_all=True, append_images=others, tiffinfo=directory, **options)


@pytest.mark.parametrize("orientation", [2, 3, 4, 5, 6, 7, 8])
def test_a_file_that_viewers_turn_or_mirror_is_refused(tmp_path: Path, orientation: int) -> None:
    save(tmp_path / "a.tif", levels(), {ORIENTATION: orientation})
    with pytest.raises(ImageError, match=r"a\.tif: images: found the orientation [A-Z]+, by which"):
        load_stack(tmp_path / "a.tif")
    save(tmp_path / "a.tif", levels(), {ORIENTATION: 1})
    assert np.array_equal(load_stack(tmp_path / "a.tif").levels, levels())


def test_a_palette_is_read_where_it_is_the_grey_of_each_level(tmp_path: Path) -> None:
    picture = Image.fromarray(levels()[0])
    for name, palette in (
        ("grey", [level for level in range(256) for _ in "rgb"]),
        ("jet", [value for level in range(256) for value in (level, 255 - level, 0)]),
    ):
        indexed = picture.copy()
        indexed.putpalette(palette)
        indexed.save(tmp_path / f"{name}.tif")
    assert np.array_equal(load_stack(tmp_path / "grey.tif").levels, levels())
    with pytest.raises(ImageError, match=r"jet\.tif.*levels that mean PALETTE"):
        load_stack(tmp_path / "jet.tif")


def test_levels_that_jpeg_has_changed_are_refused(tmp_path: Path) -> None:
    save(tmp_path / "a.tif", levels(), {}, compression="jpeg")
    with pytest.raises(ImageError, match=r"a\.tif.*compressed by JPEG, which changes them"):
        load_stack(tmp_path / "a.tif")


@pytest.mark.parametrize("unit", ["micron", "um", "µm", r"\u00B5m"])
def test_the_pixel_size_of_imagej_is_known(tmp_path: Path, unit: str) -> None:
    text = f"ImageJ=1.54f\nimages=3\nslices=3\nunit={unit}\n".encode()
    tags = {DESCRIPTION: text, X_RESOLUTION: 8.0, Y_RESOLUTION: 10.0}
    save(tmp_path / "a.tif", levels(3), tags)
    stack = load_stack(tmp_path / "a.tif")
    assert np.array_equal(stack.levels, levels(3))
    assert stack.levels.sources[0].pixel_nm == pytest.approx((100.0, 125.0))


def test_dots_per_inch_are_no_size_of_a_pixel(tmp_path: Path) -> None:
    save(tmp_path / "a.tif", levels(), {}, dpi=(300, 300))
    assert load_stack(tmp_path / "a.tif").levels.sources[0].pixel_nm is None


def test_the_frames_and_the_pixel_size_of_ome_are_known(tmp_path: Path) -> None:
    text = (
        '<?xml version="1.0" encoding="UTF-8"?><OME '
        'xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06"><Image ID="Image:0">'
        '<Pixels ID="Pixels:0" DimensionOrder="XYZCT" Type="uint8" SizeX="11" SizeY="9" SizeZ="1" '
        'SizeC="1" SizeT="3" PhysicalSizeX="0.11" PhysicalSizeY="110" PhysicalSizeYUnit="nm">'
        '<Channel ID="Channel:0:0" SamplesPerPixel="1"/><TiffData/></Pixels></Image></OME>'
    )
    save(tmp_path / "a.ome.tif", levels(3), {DESCRIPTION: text.encode()})
    stack = load_stack(tmp_path / "a.ome.tif")
    assert np.array_equal(stack.levels, levels(3))
    assert stack.levels.sources[0].pixel_nm == pytest.approx((110.0, 110.0))


def test_a_hyperstack_is_read_where_it_is_one_series(tmp_path: Path) -> None:
    for axes, n in (("TYX", 4), ("ZYX", 4)):
        tifffile.imwrite(tmp_path / "a.tif", levels(n), imagej=True, metadata={"axes": axes})
        assert np.array_equal(load_stack(tmp_path / "a.tif").levels, levels(n))
    two = levels(6).reshape(3, 2, 9, 11)
    tifffile.imwrite(tmp_path / "b.tif", two, imagej=True, metadata={"axes": "TCYX"})
    with pytest.raises(ImageError, match=r"shape \(3, 2, 9, 11\) \(axes TCYX\), expected heights"):
        load_stack(tmp_path / "b.tif")


def test_floats_of_another_writer_keep_every_digit(tmp_path: Path) -> None:
    heights = np.random.default_rng(7).normal(size=(2, 9, 11)).astype(np.float32)
    save(tmp_path / "a.tif", heights, {}, compression="tiff_lzw")
    assert np.array_equal(load_stack(tmp_path / "a.tif").levels, heights)

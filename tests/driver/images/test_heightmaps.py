from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tifffile

from driver.images.heightmaps import ImageError, fill_off_surface, on_surface, read_stack


def frames(dtype: str) -> np.ndarray:
    rng = np.random.default_rng(1)
    if dtype == "float32":
        return rng.normal(size=(5, 9, 11)).astype(dtype)
    return rng.integers(0, np.iinfo(dtype).max, size=(5, 9, 11), endpoint=True).astype(dtype)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("compression", [None, "deflate"])
def test_every_digit_of_a_tiff_stack_survives(
    tmp_path: Path, dtype: str, compression: str | None
) -> None:
    stack = frames(dtype)
    tifffile.imwrite(tmp_path / "a.tif", stack, compression=compression)
    levels = read_stack(tmp_path / "a.tif")
    assert levels.dtype == np.float64
    assert np.array_equal(levels, stack.astype(np.float64))


def test_a_single_page_is_a_stack_of_one(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", frames("uint16")[0])
    assert read_stack(str(tmp_path / "a.tif")).shape == (1, 9, 11)


def test_an_npy_array_of_doubles_survives(tmp_path: Path) -> None:
    stack = np.random.default_rng(2).normal(size=(3, 4, 5))
    np.save(tmp_path / "a.npy", stack)
    assert np.array_equal(read_stack(tmp_path / "a.npy"), stack)


def test_a_folder_and_a_pattern_are_read_in_natural_order(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        tifffile.imwrite(tmp_path / f"frame{number}.tif", np.full((4, 6), number, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    for path in (tmp_path, tmp_path / "frame*.tif"):
        assert list(read_stack(path)[:, 0, 0]) == [1, 9, 10]


@pytest.mark.parametrize("compression", [None, "deflate"])
@pytest.mark.parametrize("kept", [0.02, 0.3, 0.6, 0.9])
def test_a_truncated_tiff_is_named(tmp_path: Path, compression: str | None, kept: float) -> None:
    file = tmp_path / "cut.tif"
    tifffile.imwrite(
        file, frames("uint16"), compression=compression, metadata=None, photometric="minisblack"
    )
    content = file.read_bytes()
    file.write_bytes(content[: int(kept * len(content))])
    with pytest.raises(ImageError, match="cut.tif"):
        read_stack(file)


def test_a_truncated_npy_is_named(tmp_path: Path) -> None:
    file = tmp_path / "cut.npy"
    np.save(file, frames("uint8"))
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(ImageError, match="cut.npy"):
        read_stack(file)


def test_frames_of_two_sizes_are_refused_with_both_sizes(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a1.tif", np.ones((4, 6), np.uint8))
    tifffile.imwrite(tmp_path / "a2.tif", np.ones((5, 6), np.uint8))
    with pytest.raises(ImageError, match=r"a2\.tif.*5 × 6.*a1\.tif.*4 × 6"):
        read_stack(tmp_path)


def test_pages_of_two_sizes_in_one_file_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        tiff.write(np.ones((4, 6), np.uint8), metadata=None)
        tiff.write(np.ones((5, 6), np.uint8), metadata=None)
    with pytest.raises(ImageError, match="a.tif.*alike"):
        read_stack(tmp_path / "a.tif")


def test_colours_nothing_and_text_are_refused(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "rgb.tif", np.ones((4, 6, 3), np.uint8), photometric="rgb")
    np.save(tmp_path / "none.npy", np.ones((0, 4, 6)))
    np.save(tmp_path / "text.npy", np.array([["a", "b"]]))
    for name, word in (("rgb.tif", "colours"), ("none.npy", "no pixel"), ("text.npy", "type")):
        with pytest.raises(ImageError, match=f"{name}.*{word}"):
            read_stack(tmp_path / name)
    with pytest.raises(ImageError, match="missing.*no image found"):
        read_stack(tmp_path / "missing")


def test_a_trench_is_filled_with_the_nearest_height() -> None:
    heights = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, np.nan], [4.0, 5.0, 6.0]])
    filled = fill_off_surface(heights, on_surface(heights))
    assert list(filled[0, :2]) == [1.0, 2.0]
    assert filled[1, 2] in (2.0, 6.0)
    assert list(filled[2]) == [4.0, 5.0, 6.0]

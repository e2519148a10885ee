from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import h5py
import imagecodecs
import numpy as np
import pytest
import tifffile

from driver.experiment.images.files import gap
from driver.experiment.images.heightmaps import ImageError, fill_off_surface, load_stack, on_surface


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
    levels = load_stack(tmp_path / "a.tif").levels
    assert all(level.dtype == stack.dtype for level in levels)
    assert np.array_equal(levels, stack)


@pytest.mark.parametrize("kind", ["strips", "tiles", "big-endian", "float", "chunks", "columns"])
def test_frames_that_are_read_by_several_threads_at_a_time_are_those_of_the_file(
    tmp_path: Path, kind: str
) -> None:
    stack: np.ndarray = np.random.default_rng(4).integers(0, 2**16, (23, 40, 50), np.uint16)
    options: dict[str, dict[str, Any]] = {
        "strips": {"compression": "lzw", "rowsperstrip": 7, "predictor": True},
        "tiles": {"tile": (16, 16), "compression": "zlib"},
        "big-endian": {"byteorder": ">"},
        "float": {"compression": "zlib", "predictor": 3},
    }
    path: str | Path = tmp_path / "a.tif"
    if kind == "float":
        stack = stack.astype(np.float32) / 7
    if kind == "chunks":
        with h5py.File(tmp_path / "a.h5", "w") as file:
            file.create_dataset("a", data=stack, chunks=(5, 16, 16), compression="gzip")
        path = f"{tmp_path / 'a.h5'}:/a"
    elif kind == "columns":
        path = tmp_path / "a.npy"
        np.save(path, np.asfortranarray(stack))
    else:
        tifffile.imwrite(path, stack, metadata=None, photometric="minisblack", **options[kind])
    levels = load_stack(path).levels
    order = np.random.default_rng(5).permutation(np.repeat(np.arange(len(stack)), 3))
    with ThreadPoolExecutor(3) as threads:
        read = list(threads.map(levels.__getitem__, order.tolist()))
    assert np.array_equal(read, stack[order]) and read[0].dtype.isnative


@pytest.mark.parametrize("name", ["a.tif", "a.npy", "a.png", "a.h5:/a"])
def test_a_file_that_goes_while_its_frames_are_read_is_named(tmp_path: Path, name: str) -> None:
    frame = frames("uint8")[:1]
    tifffile.imwrite(tmp_path / "a.tif", frame, compression="deflate")
    np.save(tmp_path / "a.npy", frame)
    (tmp_path / "a.png").write_bytes(imagecodecs.png_encode(frame[0]))
    with h5py.File(tmp_path / "a.h5", "w") as content:
        content["a"] = frame
    levels = load_stack(tmp_path / name, "images.frames").levels
    (tmp_path / name.partition(":")[0]).unlink()
    told = r"a\.\w+: images.frames: found .*, expected the file that was read at first"
    with pytest.raises(ImageError, match=told):
        levels[0]


def test_a_single_page_is_a_stack_of_one(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a.tif", frames("uint16")[0])
    assert np.shape(load_stack(str(tmp_path / "a.tif")).levels) == (1, 9, 11)


def test_an_npy_array_of_doubles_survives(tmp_path: Path) -> None:
    stack = np.random.default_rng(2).normal(size=(3, 4, 5))
    np.save(tmp_path / "a.npy", stack)
    assert np.array_equal(load_stack(tmp_path / "a.npy").levels, stack)


def test_a_folder_and_a_pattern_are_read_in_natural_order(tmp_path: Path) -> None:
    for number in (10, 9, 1):
        tifffile.imwrite(tmp_path / f"frame{number}.tif", np.full((4, 6), number, np.uint8))
    (tmp_path / "notes.txt").write_text("not an image")
    for path in (tmp_path, tmp_path / "frame*.tif"):
        assert [levels[0, 0] for levels in load_stack(path).levels] == [1, 9, 10]


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
        load_stack(file)


def test_a_truncated_npy_is_named(tmp_path: Path) -> None:
    file = tmp_path / "cut.npy"
    np.save(file, frames("uint8"))
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(ImageError, match="cut.npy"):
        load_stack(file)


def test_frames_of_two_sizes_are_refused_with_both_sizes(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a1.tif", np.ones((4, 6), np.uint8))
    tifffile.imwrite(tmp_path / "a2.tif", np.ones((5, 6), np.uint8))
    with pytest.raises(ImageError, match=r"a2\.tif.*5 × 6.*4 × 6.*a1\.tif"):
        load_stack(tmp_path)


def test_pages_of_two_sizes_in_one_file_are_refused(tmp_path: Path) -> None:
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        tiff.write(np.ones((4, 6), np.uint8), metadata=None)
        tiff.write(np.ones((5, 6), np.uint8), metadata=None)
    with pytest.raises(ImageError, match="a.tif.*alike"):
        load_stack(tmp_path / "a.tif")


def test_colours_nothing_and_text_are_refused(tmp_path: Path) -> None:
    grey = np.ones((3, 4, 6), np.uint8)
    tifffile.imwrite(tmp_path / "rgb.tif", grey.transpose(1, 2, 0).copy(), photometric="rgb")
    tifffile.imwrite(tmp_path / "planes.tif", grey, photometric="rgb")
    tifffile.imwrite(tmp_path / "white.tif", grey[0], photometric="miniswhite")
    (tmp_path / "rgba.png").write_bytes(imagecodecs.png_encode(np.ones((4, 6, 4), np.uint8)))
    (tmp_path / "alpha.png").write_bytes(imagecodecs.png_encode(np.ones((4, 6, 2), np.uint8)))
    np.save(tmp_path / "none.npy", np.ones((0, 4, 6)))
    np.save(tmp_path / "text.npy", np.array([["a", "b"]]))
    np.save(tmp_path / "deep.npy", np.ones((2, 2, 4, 6)))
    words = {
        "rgb.tif": "3 colour channels", "planes.tif": "saved anew as grey pages",
        "white.tif": "MINISWHITE", "rgba.png": "RGBA", "alpha.png": "grey with alpha",
        "none.npy": "no pixel", "text.npy": "type", "deep.npy": "shape",
    }  # fmt: skip
    for name, word in words.items():
        with pytest.raises(ImageError, match=f"{name}: images.flats: found .*{word}"):
            load_stack(tmp_path / name, "images.flats")
    with pytest.raises(ImageError, match="missing: images: found no image"):
        load_stack(tmp_path / "missing")


@pytest.mark.parametrize("n", [3, 4])
def test_three_or_four_pages_are_frames_not_colours(tmp_path: Path, n: int) -> None:
    stack = np.concatenate([frames("uint8")] * 2)[:n]
    tifffile.imwrite(tmp_path / "shaped.tif", stack, photometric="minisblack")
    with tifffile.TiffWriter(tmp_path / "pages.tif") as tiff:
        for page in stack:
            tiff.write(page, metadata=None)
    tifffile.imwrite(tmp_path / "imagej.tif", stack, imagej=True, metadata={"axes": "CYX"})
    for name in ("shaped.tif", "pages.tif", "imagej.tif"):
        assert np.array_equal(load_stack(tmp_path / name).levels, stack)


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_a_png_survives_and_a_damaged_one_is_named(tmp_path: Path, dtype: str) -> None:
    content = imagecodecs.png_encode(frames(dtype)[0])
    (tmp_path / "a.png").write_bytes(content)
    assert np.array_equal(load_stack(tmp_path / "a.png").levels[0], frames(dtype)[0])
    for kept in (5, 40, len(content) // 2):
        (tmp_path / "cut.png").write_bytes(content[:kept])
        with pytest.raises(ImageError, match="cut.png"):
            load_stack(tmp_path / "cut.png")


def test_a_dataset_of_hdf5_survives_and_a_wrong_name_lists_the_right_ones(tmp_path: Path) -> None:
    stack = np.random.default_rng(3).normal(size=(3, 4, 5))
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["scan/heights"] = stack
    assert np.array_equal(load_stack(tmp_path / "a.h5:/scan/heights").levels, stack)
    for path in ("a.h5", "a.h5:/scan", "a.h5:/other"):
        with pytest.raises(ImageError, match="expected a.h5:NAME with NAME one of /scan/heights"):
            load_stack(tmp_path / path)
    (tmp_path / "a.h5").write_bytes((tmp_path / "a.h5").read_bytes()[:400])
    with pytest.raises(ImageError, match="a.h5: images: found “.*”, expected an HDF5 file"):
        load_stack(tmp_path / "a.h5:/scan/heights")


def test_a_gap_is_seen_in_equal_steps_alone() -> None:
    assert gap(["a_1.tif", "a_2.tif", "a_4.tif", "a_5.tif"]) == "a_4.tif follows a_2.tif"
    assert gap(["t0_5.tif", "t0_10.tif", "t0_15.tif"]) == ""
    assert gap(["a.tif", "b_2.tif"]) == "" and gap(["one.tif"]) == ""
    assert gap(["a_1_7.tif", "a_2_9.tif"]) == ""  # two numbers run: neither is known to count


def test_files_of_two_types_are_refused_for_their_levels_mean_two_heights(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "a1.tif", np.ones((4, 6), np.uint8))
    tifffile.imwrite(tmp_path / "a2.tif", np.ones((4, 6), np.uint16))
    with pytest.raises(ImageError, match="a2.tif.*type uint16, expected uint8 as a1.tif"):
        load_stack(tmp_path)


def test_a_trench_is_filled_with_the_nearest_height() -> None:
    nothing = np.nan
    heights = np.array([[nothing, np.inf, nothing], [1.0, 2.0, nothing], [4.0, 5.0, 6.0]])
    filled = fill_off_surface(heights, on_surface(heights))
    assert list(filled[0, :2]) == [1.0, 2.0]
    assert filled[1, 2] in (2.0, 6.0)
    assert list(filled[2]) == [4.0, 5.0, 6.0]


def test_brackets_in_the_name_of_a_folder_are_no_pattern(tmp_path: Path) -> None:
    folder = tmp_path / "specimen [2] *"
    folder.mkdir()
    for number in (1, 2):
        tifffile.imwrite(folder / f"frame{number}.tif", np.full((4, 6), number, np.uint8))
    for path in (folder, folder / "frame[0-9].tif", tmp_path / "spec*" / "frame*.tif"):
        assert len(load_stack(path)) == 2

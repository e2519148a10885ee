"""What a header claims is judged before a byte is decoded."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import pytest
import tifffile

from driver.experiment.images.files import Refused
from driver.experiment.images.formats import open_file
from driver.experiment.images.headers import header

LARGE = r"pixels by its header, .* GB of levels"


def png(rows: int, columns: int) -> bytes:
    """The beginning of a grey PNG of 8 bits, and nothing of its levels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + check

    size = struct.pack(">IIBBBBB", columns, rows, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", size) + chunk(b"IDAT", b"") + chunk(b"IEND", b"")


def npy(shape: tuple[int, ...]) -> bytes:
    text = str({"descr": "<f8", "fortran_order": False, "shape": shape}).encode()
    text = text.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text


def test_an_array_that_claims_a_terabyte_or_more_than_numbers_hold_is_refused(
    tmp_path: Path,
) -> None:
    file = tmp_path / "a.npy"
    for shape in ((2000, 8000, 8000), (2**40, 2**40), (1, 2**62, 2)):
        file.write_bytes(npy(shape))
        with pytest.raises(Refused) as refused:
            open_file(file)
        assert "pixels by its header" in refused.value.found


def test_a_picture_of_two_thousand_million_pixels_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(png(50_000, 50_000))
    with pytest.raises(Refused, match=rf"50000 × 50000 {LARGE}"):
        open_file(tmp_path / "a.png")


def test_a_tiff_that_deflates_to_nothing_is_refused_before_it_is_decoded(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    tile = np.zeros((1, 1024, 1024), dtype=np.uint8)
    with tifffile.TiffWriter(file) as tiff:
        tiff.write(
            (tile[0] for _ in range(30 * 30)), shape=(30_720, 30_720), dtype=np.uint8,
            tile=(1024, 1024), compression="zlib", photometric="minisblack",
        )  # fmt: skip
    assert file.stat().st_size < 2_000_000
    with pytest.raises(Refused, match=rf"1 × 30720 × 30720 {LARGE}"):
        open_file(file)


def test_a_dataset_that_is_nowhere_on_the_disk_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.h5"
    with h5py.File(file, "w") as content:
        content.create_dataset("a", (20_000, 1000, 1000), np.uint8, chunks=(1, 1000, 1000))
    assert file.stat().st_size < 100_000
    with pytest.raises(Refused, match=rf"20000 × 1000 × 1000 {LARGE}"):
        open_file(file, "a")


def test_a_tiff_whose_directory_points_at_itself_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    tifffile.imwrite(file, np.zeros((2, 8, 8), dtype=np.uint8), photometric="minisblack")
    data = bytearray(file.read_bytes())
    (first,) = struct.unpack_from("<I", data, 4)
    (tags,) = struct.unpack_from("<H", data, first)
    struct.pack_into("<I", data, first + 2 + 12 * tags, first)
    file.write_bytes(data)
    with pytest.raises(Refused, match="pages that follow each other in a circle"):
        open_file(file)


def test_an_array_that_is_no_stack_of_images_is_told_by_its_shape(tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", np.zeros((1, 2, 6, 10)))
    with pytest.raises(Refused) as refused:
        open_file(tmp_path / "a.npy")
    assert refused.value.found == "an array of shape (1, 2, 6, 10)"
    assert refused.value.expected.startswith("heights of shape (rows, columns)")


@pytest.mark.parametrize("suffix", [".npy", ".png", ".tif", ".h5"])
def test_the_header_tells_shape_and_type_of_what_is_read(suffix: str, tmp_path: Path) -> None:
    levels, file = np.arange(60, dtype=np.uint8).reshape(1, 6, 10), tmp_path / f"a{suffix}"
    if suffix == ".npy":
        np.save(file, levels)
    elif suffix == ".tif":
        tifffile.imwrite(file, levels, photometric="minisblack")
    elif suffix == ".png":
        file.write_bytes(imagecodecs.png_encode(levels[0]))
    else:
        with h5py.File(file, "w") as content:
            content["a"] = levels
    shape, kind = header(file, "a")
    read = open_file(file, "a")
    assert shape[-2:] == read.shape[-2:] == (6, 10) and kind == read.dtype

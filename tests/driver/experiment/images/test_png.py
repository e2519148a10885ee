"""PNG files that tell the range of their heights; written by Pillow."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, PngImagePlugin

from driver.experiment.images.heightmaps import ImageError, load_stack
from meshes.arrays import FloatArray

LEVELS = 65535


def stretched(heights: FloatArray) -> tuple[Image.Image, float, float]:
    """An image of all levels of 16 bits, and the heights at its ends."""
    low, high = float(heights.min()), float(heights.max())
    levels = np.rint((heights - low) / (high - low) * LEVELS).astype(np.uint16)
    return Image.fromarray(levels), low, high


def gwyddion(
    file: Path, heights: FloatArray, unit: str = "m", pixel: float = 110e-9, packed: bool = False
) -> None:
    """Write heights in a unit as Gwyddion does: keywords of its image-keys.h, version 2.61."""
    image, low, high = stretched(heights)
    rows, columns = heights.shape
    texts = PngImagePlugin.PngInfo()
    for key, value in {
        "Title": "Height", "Software": "Gwyddion",
        "Gwy::XReal": f"{columns * pixel:.12g}", "Gwy::YReal": f"{rows * pixel:.12g}",
        "Gwy::ZMin": f"{low:.12g}", "Gwy::ZMax": f"{high:.12g}",
    }.items():  # fmt: skip
        texts.add_text(key, value, zip=packed)
    texts.add_itxt("Gwy::XYUnit", "m")
    texts.add_itxt("Gwy::ZUnit", unit)
    image.save(file, pnginfo=texts)


def with_chunk(file: Path, image: Image.Image, kind: bytes, content: bytes) -> None:
    """Save an image with a chunk after its header, of those that Pillow does not write."""
    image.save(file)
    data = file.read_bytes()
    body = kind + content
    chunk = len(content).to_bytes(4) + body + zlib.crc32(body).to_bytes(4)
    file.write_bytes(data[:33] + chunk + data[33:])


def relief(t: int) -> FloatArray:
    """Heights of a surface whose noise has another range in each frame [nm]."""
    rng = np.random.default_rng(4)
    surface = rng.normal(0.0, 40.0, (30, 44))
    return surface + 7.0 * t + np.random.default_rng(t).normal(0.0, 9.0, surface.shape)


@pytest.mark.parametrize(
    ("unit", "metres", "packed"), [("m", 1.0, False), ("m", 1.0, True), ("µm", 1e-6, False)]
)
def test_images_that_were_each_stretched_are_heights_again(
    tmp_path: Path, unit: str, metres: float, packed: bool
) -> None:
    for t in range(4):
        gwyddion(tmp_path / f"{t}.png", relief(t) * 1e-9 / metres, unit, packed=packed)
    stack = load_stack(tmp_path)
    source = stack.levels.sources[0]
    assert source.in_nm and source.pixel_nm == pytest.approx((110.0, 110.0))
    for t in range(4):
        # half a level of a range of 300 nm
        assert stack[t] == pytest.approx(relief(t), abs=0.003)


def test_the_chunk_of_the_standard_tells_the_range_too(tmp_path: Path) -> None:
    image, low, high = stretched(relief(0))
    head = b"Z\0" + struct.pack(">iiBB", 0, LEVELS, 0, 2) + b"nm\0"
    content = head + f"{low:.9g}".encode() + b"\0" + f"{high - low:.9g}".encode()
    with_chunk(tmp_path / "a.png", image, b"pCAL", content)
    assert load_stack(tmp_path / "a.png")[0] == pytest.approx(relief(0), abs=0.003)


@pytest.mark.parametrize("unit", ["", " "])
def test_a_range_without_a_unit_leaves_the_levels_as_they_are(tmp_path: Path, unit: str) -> None:
    gwyddion(tmp_path / "a.png", relief(0), unit)
    stack = load_stack(tmp_path / "a.png")
    assert stack.dtype == np.uint16 and stack[0].max() == LEVELS


def test_a_range_of_another_unit_is_refused_with_it(tmp_path: Path) -> None:
    gwyddion(tmp_path / "a.png", 1e-3 * relief(0), "V")
    with pytest.raises(ImageError, match=r"found levels that stand for -0.* V, expected heights"):
        load_stack(tmp_path / "a.png")


def test_chunks_that_are_cut_or_wrong_are_passed_over(tmp_path: Path) -> None:
    image, _, _ = stretched(relief(0))
    for name, content in {
        "short": b"Z\0\0\0", "empty": b"", "equation": b"Z\0" + struct.pack(">iiBB", 0, 9, 1, 3),
        "numbers": b"Z\0" + struct.pack(">iiBB", 0, 9, 0, 2) + b"nm\0a\0b",
        "turned": b"Z\0" + struct.pack(">iiBB", 9, 0, 0, 2) + b"nm\x001\x002",
        "packed": b"Gwy::ZMin\0\0no zlib",
    }.items():  # fmt: skip
        kind = b"zTXt" if name == "packed" else b"pCAL"
        with_chunk(tmp_path / f"{name}.png", image, kind, content)
        assert load_stack(tmp_path / f"{name}.png").dtype == np.uint16

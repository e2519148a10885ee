"""Frames of files of every kind, handed from one process to another."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import h5py
import imagecodecs
import numpy as np
import pytest
import tifffile

from driver.experiment.images.file_frames import Levels
from driver.experiment.images.formats import open_file

LEVELS = np.arange(3 * 8 * 16, dtype=np.uint16).reshape(3, 8, 16) * 37


def contiguous(file: Path, levels: Levels) -> None:
    tifffile.imwrite(file, levels, photometric="minisblack")


def big_endian(file: Path, levels: Levels) -> None:
    tifffile.imwrite(file, levels, byteorder=">", photometric="minisblack")


def compressed(file: Path, levels: Levels) -> None:
    tifffile.imwrite(file, levels, compression="zlib", photometric="minisblack")


def array(file: Path, levels: Levels) -> None:
    np.save(file, levels)


def single(file: Path, levels: Levels) -> None:
    file.write_bytes(imagecodecs.png_encode(levels[0]))


def chunks(file: Path, levels: Levels) -> None:
    with h5py.File(file, "w") as content:
        content.create_dataset("heights", data=levels, chunks=(2, 8, 16))


KINDS = [
    (contiguous, ".tif"), (big_endian, ".tif"), (compressed, ".tif"), (array, ".npy"),
    (single, ".png"), (chunks, ".h5"),
]  # fmt: skip


@pytest.mark.parametrize(("write", "suffix"), KINDS, ids=lambda of: getattr(of, "__name__", of))
def test_frames_are_the_same_in_a_process_that_gets_them(
    write: Callable[[Path, Levels], None], suffix: str, tmp_path: Path
) -> None:
    file = tmp_path / f"images{suffix}"
    write(file, LEVELS)
    frames = open_file(file, "heights")
    handed = pickle.loads(pickle.dumps(frames))
    assert (handed.shape, handed.dtype) == (frames.shape, frames.dtype)
    for index in range(len(frames)):
        assert np.array_equal(handed.read(index), LEVELS[index])

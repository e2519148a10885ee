"""Memory and time of the measurement against the number of images."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy import ndimage

from driver.case.model import load_case, write_case
from driver.common.splines.images import spline_images
from meshes.arrays import FloatArray

MANY = (100, 500, 2000)  # images
_SIDE, _PIXEL = 557, 0.025  # px of an image; µm
_ORIGIN = (278.0, 38.0)  # px; a face of 12 × 4 µm has 480 × 160 of them
_LEVEL, _NOISE, _RELIEF = 6.5, 9.0, 45.0  # nm; of 8 bits
_DRIFT, _STRETCH = 1.0, 0.8  # px
_REPEATS, _FLATS = 10, 100
_ALPHA = Path(__file__).parent.parent / "examples" / "alpha" / "case.toml"


def levels(heights: FloatArray, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Heights [nm] as an instrument of 8 bits gives them, with its noise."""
    noisy = heights + _NOISE * rng.normal(size=heights.shape)
    return np.clip(np.rint(128 + noisy / _LEVEL), 1, 255).astype(np.uint8)


def write_series(folder: Path, n_images: int) -> Path:
    """Write a case of so many images, in moves and holds; return its file."""
    rng = np.random.default_rng(3)
    relief = ndimage.gaussian_filter(rng.normal(size=(_SIDE, _SIDE)), 3.0)
    relief *= _RELIEF / relief.std()
    spline = spline_images(relief[None], 1.0, (0.0, 0.0))
    row, column = np.indices(relief.shape, dtype=np.float64)
    along = (column - _ORIGIN[1]) * _PIXEL / 12.0
    share = 1.0 - np.abs(np.linspace(-1.0, 0.5, n_images))  # of the largest travel
    with tifffile.TiffWriter(folder / "images.tif") as frames:
        for t, loaded in enumerate(share):
            drift = _DRIFT * np.sin(t / 7), _DRIFT * np.cos(t / 11)
            moved = row - drift[0], column - drift[1] - _STRETCH * loaded * along
            frames.write(levels(spline.value(0, *moved), rng), contiguous=True)
    for name, heights, n in (("repeats", relief, _REPEATS), ("flats", 0 * relief, _FLATS)):
        stack = np.array([levels(heights, rng) for _ in range(n)])
        tifffile.imwrite(folder / f"{name}.tif", stack, photometric="minisblack")
    rows = ["time_s,stage_um,image,force_N", "0,0,0,0"]
    for t, loaded in enumerate(share[1:], start=1):
        rows += [f"{40 * t - 30},{50 * loaded},,", f"{40 * t},{50 * loaded},{t},{100 + loaded}"]
    (folder / "history.csv").write_text("\n".join(rows) + "\n")
    stated = {
        "images.pixel_size_nm": 1e3 * _PIXEL, "images.origin_pixel": _ORIGIN,
        "images.height_per_level_nm": _LEVEL, "images.noise_nm": _NOISE,
    }  # fmt: skip
    case = load_case(_ALPHA).with_values_at(stated)
    write_case(case, folder / "case.toml")
    return folder / "case.toml"


def memory_of_images(n_images: int) -> tuple[float, float]:
    """Peak memory [GB] and CPU time [s] of a process that measures so many images of 557²."""
    with TemporaryDirectory(dir=Path.cwd()) as name:
        case = write_series(Path(name), n_images)
        command = [sys.executable, "-P", "-m", "driver.cli", "run", str(case), "--until", "measure"]
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        _, status, used = os.wait4(process.pid, 0)
        if status:
            raise RuntimeError(f"{' '.join(command)} ended with status {status}")
    return used.ru_maxrss * 1024 / 1e9, used.ru_utime + used.ru_stime

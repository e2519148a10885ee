"""What much costs: many jobs beside their work, and the memory of many images.

    python -m benchmarks.scale           1, 10, 100 and 1000 tasks, a campaign of eight cases, and
                                         `measure` with 500 and 2000 images of 557²
    python -m benchmarks.scale --quick   10 and 100 tasks, and the start of one case
    python -m benchmarks.scale --images 200 400    the memory of so many images alone

Wall-clock times hold on free cores alone.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import tifffile
from numpy.typing import NDArray
from scipy import ndimage

from benchmarks.measuring import show
from driver.batch.command import batch
from driver.case.model import load_case, write_case
from driver.common.parallel import side_by_side
from driver.common.splines.images import spline_images
from meshes.arrays import FloatArray
from tools.short_specimen import small_case

_WORK = 0.02  # s of a task
_CASES = 8
_MANY = (500, 2000)  # images
_SIDE, _PIXEL = 557, 0.025  # px of an image; µm
_ORIGIN = (278.0, 38.0)  # px; a face of 12 × 4 µm has 480 × 160 of them
_LEVEL, _NOISE, _RELIEF = 6.5, 9.0, 45.0  # nm; of 8 bits
_DRIFT, _STRETCH = 1.0, 0.8  # px
_REPEATS, _FLATS = 10, 100
_ALPHA = Path(__file__).parent.parent / "examples" / "alpha" / "case.toml"


def work(seconds: float) -> None:
    """Be at work for some time."""
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        pass


def overhead_of_tasks(number: int, processes: int) -> float:
    """Wall-clock time of each task beside its share of the work [s]."""
    begin = time.perf_counter()
    side_by_side(work, [_WORK] * number, processes)
    wall = time.perf_counter() - begin
    return (wall - number * _WORK / processes) / number


def start_of_a_case() -> float:
    """Wall-clock time of a process that starts prismid and does nothing [s]."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-P", "-m", "driver.cli", "run", "--help"], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    return time.perf_counter() - begin


def campaign(number: int) -> float:
    """Wall-clock time of each case of a campaign that only meshes [s]."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        case = small_case().with_values_at({"specimen.cells": "hex20"})
        (folder / "base").mkdir()
        rows = "time_s,stage_um,image,force_N\n0,0,0,0\n10,5,1,1\n20,10,2,2\n"
        (folder / "base" / case.history.file).write_text(rows)
        write_case(case, folder / "base" / "case.toml")
        noises = [1.0 + k for k in range(number)]
        (folder / "campaign.toml").write_text(
            'until = "mesh"\n[[study]]\ncase = "base/case.toml"\n'
            f'values."loads.noise_uN" = {noises}\n'
        )
        begin = time.perf_counter()
        assert batch(folder / "campaign.toml", lambda states, at_a_time: None)
        return (time.perf_counter() - begin) / number


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


def show_images(numbers: Sequence[int]) -> None:
    """Print what so many images take."""
    for number in numbers:
        memory, seconds = memory_of_images(number)
        what = f"{number} images of {_SIDE}^2 through measure"
        goal = "<= 2" if number == _MANY[-1] else None
        show(f"{what}, peak memory [GB]", memory, goal)
        show(f"{what}, CPU time of an image [s]", seconds / number)


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    parser.add_argument("--images", type=int, nargs="+", help="memory of so many images alone")
    arguments = parser.parse_args()
    quick = arguments.quick
    if arguments.images:
        show_images(arguments.images)
        return
    processes = os.cpu_count() or 1
    for number in (10, 100) if quick else (1, 10, 100, 1000):
        overhead = 1e3 * overhead_of_tasks(number, processes)
        show(f"{number} tasks of 20 ms on {processes} processes: overhead of each [ms]", overhead,
             "<= 50")  # fmt: skip
    show("start of a process of prismid [s]", start_of_a_case())
    if not quick:
        show(f"campaign of {_CASES} cases that mesh: wall-clock time of each [s]",
             campaign(_CASES))  # fmt: skip
        show_images(_MANY)


if __name__ == "__main__":
    main()

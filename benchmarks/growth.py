"""How what is asked of prismid grows with images, causes and workers: exponents by least squares.

That of the cells is `python -m benchmarks.solver --only scaling`.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.cluster_plan import cluster_in_small
from benchmarks.diagnosis import ALPHA, screened_simulations
from benchmarks.many_images import MANY, memory_of_images
from benchmarks.measuring import show
from driver.common.parallel import side_by_side
from driver.workflow import pipeline

_DIRECTIONS = (10, 20, 40, 80)
_PROCESSES = (1, 2, 4, 8)
_THREADS = (2, 4, 8)
_WAITS, _WAIT = 200, 0.1  # tasks; s of each
_CASES = 200


def exponent(costs: Mapping[int, float]) -> float:
    """Power of the size with which a cost grows, to least squares over all sizes."""
    sizes, values = np.log([*costs]), np.log([*costs.values()])
    return float(np.polyfit(sizes, values, 1)[0])


def show_growth(what: str, unit: str, costs: Mapping[int, float]) -> None:
    """Print a cost for each size, and the exponent."""
    for size, cost in costs.items():
        show(f"{what}, {size} [{unit}]", cost)
    show(f"{what}: exponent", exponent(costs))


def images() -> None:
    """Memory and CPU time of the measurement of 557² images."""
    found = {number: memory_of_images(number) for number in MANY}
    show_growth("images through measure", "CPU-s", {n: cpu for n, (_, cpu) in found.items()})
    for number, (memory, _) in found.items():
        goal = "<= 2" if number == MANY[-1] else None
        show(f"images through measure, {number}: peak memory [GB]", memory, goal)


def causes() -> None:
    """CPU time of a simulation with derivatives along the parameters of the causes."""
    with TemporaryDirectory() as folder:
        case = Path(folder) / "alpha" / "case.toml"
        shutil.copytree(ALPHA, case.parent, ignore=shutil.ignore_patterns("results"))
        pipeline.run(case, "measure", False)
        show_growth("parameters in a simulation", "CPU-s", screened_simulations(case, _DIRECTIONS))


def workers() -> None:
    """Wall-clock time of tasks that wait, on processes of this machine and on workers of Dask."""
    walls = {}
    for processes in _PROCESSES:
        begin = time.perf_counter()
        side_by_side(time.sleep, [_WAIT] * _WAITS, processes)
        walls[processes] = time.perf_counter() - begin
    show_growth(f"processes for {_WAITS} waits of {_WAIT} s", "s", walls)
    walls = {threads: cluster_in_small(_CASES, threads)[0] for threads in _THREADS}
    show_growth(f"workers of Dask for {_CASES} cases in small", "s", walls)


def show_all() -> None:
    """Print all of it."""
    workers()
    causes()
    images()

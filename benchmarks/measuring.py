"""A simulation in a process of its own: what it costs, and how that is printed."""

from __future__ import annotations

import os
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any, TypeVar

from driver.common.parallel import THREAD_VARIABLES
from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Direction, Integration, Simulation
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import box, pulled

T = TypeVar("T")
MEASURES: tuple[StrainMeasure, ...] = ("small", "finite")
SCHEMES: tuple[Integration, ...] = ("exponential", "backward_euler")
ALPHA_SIZE, SMALL_SIZE, LARGE_SIZE = 1.2, 1.0, 0.64
"""Edge lengths of the cells of the demo's prism [µm]: 477, 683 and about 2160 cells."""


@dataclass(frozen=True)
class Run:
    """Cost of one simulation.

    Attributes:
        cpu: CPU time [s].
        wall: wall-clock time [s].
        seconds: wall-clock time by component [s].
        cells, steps, iterations: size of the mesh, time steps, Newton iterations.
        memory: peak memory of the process [MB].
        force: the answered force [µN], shape (n_output,).
    """

    cpu: float
    wall: float
    seconds: dict[str, float]
    cells: int
    steps: int
    iterations: int
    memory: float
    force: FloatArray


def in_child(work: Callable[..., T], *arguments: Any, threads: int = 1, **variables: str) -> T:
    """Call a function in a fresh process with the given threads and environment variables."""
    limits = dict.fromkeys(THREAD_VARIABLES, "1")
    changes = {**limits, "NUMBA_NUM_THREADS": str(threads), **variables}
    before = dict(os.environ)
    os.environ.update(changes)
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(work, *arguments).result()
    finally:
        os.environ.clear()
        os.environ.update(before)


def show(name: str, value: float, goal: str | None = None) -> None:
    """Print one figure; the unit stands in its name."""
    print(f"{name} = {value:.3g}" + (f" (goal: {goal})" if goal else ""), flush=True)


def show_parts(run: Run) -> None:
    """Print where the time of a run went."""
    parts = ", ".join(f"{name} {100 * s / run.wall:.0f} %" for name, s in run.seconds.items())
    print(
        f"    {run.cells} cells, {run.steps} steps, {run.iterations} iterations, "
        f"{run.cpu:.2f} CPU-s: {parts}"
    )


def solve(simulation: Simulation) -> Run:
    """Run a simulation with compiled kernels."""
    start, cpu = time.perf_counter(), time.process_time()
    response = BundledAdapter().solve(simulation)
    return Run(
        cpu=time.process_time() - cpu,
        wall=time.perf_counter() - start,
        seconds=dict(response.seconds),
        cells=len(simulation.mesh.cells),
        steps=response.steps,
        iterations=response.iterations,
        memory=resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        force=response.force,
    )


def warm(measure: StrainMeasure) -> float:
    """Have every kernel of a strain measure compiled or loaded; CPU time [s]."""
    start = time.process_time()
    simulation = pulled(box(), Material(strain_measure=measure), (0.004,))
    tangent = Direction("tau0", material={"tau0": 1.0})
    BundledAdapter().solve(replace(simulation, directions=(tangent,)))
    return time.process_time() - start

"""Cost of a whole test, on one thread and two, and against the number of cells."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from benchmarks.measuring import LARGE_SIZE, Run, in_child, show, show_parts, solve, warm
from benchmarks.specimens import CYCLES, EIGHT, SHORT_CYCLES, beginning, specimen, stops

SCALING_SIZES = (1.2, 0.65, 0.42, 0.275)
"""Edge lengths of the cells [µm]."""


def specimen_run(
    size: float, phases: Sequence[int], n_images: int, free: Sequence[str] = ()
) -> Run:
    """Return the demo's prism in finite strain up to an image."""
    warm("finite")
    return solve(beginning(specimen(size, "finite", stops(phases), free), n_images))


def whole_test(quick: bool) -> None:
    """Time a test of 320 images in finite strain."""
    if not quick:
        run = in_child(specimen_run, LARGE_SIZE, CYCLES, sum(CYCLES))
        show(f"{run.cells} cells, {sum(CYCLES)} images [CPU-s]", run.cpu, "<= 150")
        show_parts(run)


def threads(quick: bool) -> None:
    """Wall-clock time on one and two threads."""
    if not quick:
        load = os.getloadavg()[0]
        runs = {
            count: [
                in_child(specimen_run, LARGE_SIZE, SHORT_CYCLES, 15, threads=count)
                for _ in range(3)
            ]
            for count in (1, 2)
        }
        alone, two = (min(run.wall for run in runs[count]) for count in (1, 2))
        show("speed of two threads / one (wall clock)", alone / two, ">= 1.6")
        print(f"    load of the machine before {load:.2f}, cores {os.cpu_count()}")


def scaling(quick: bool) -> None:
    """Time and memory against the number of cells, 10 plastic steps, 8 sensitivities."""
    if quick:
        return
    runs = [in_child(specimen_run, size, SHORT_CYCLES, 5, EIGHT) for size in SCALING_SIZES]
    for run in runs:
        show(f"{run.cells} cells, 10 steps [CPU-s]", run.cpu)
        show(f"{run.cells} cells, peak memory [MB]", run.memory)
        show_parts(run)
    cells = np.log([run.cells for run in runs])
    names = {name: [run.seconds[name] for run in runs] for name in runs[0].seconds}
    for name, values in {"CPU time": [run.cpu for run in runs], **names}.items():
        show(
            f"exponent of {name} in the number of cells",
            float(np.polyfit(cells, np.log(values), 1)[0]),
        )

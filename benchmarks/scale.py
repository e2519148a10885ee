"""What many jobs cost beside their work: tasks side by side, cases of a campaign, a cluster.

    python -m benchmarks.scale           1, 10, 100 and 1000 tasks, a campaign, a cluster in small,
                                         and how costs grow with images, causes and workers
    python -m benchmarks.scale --quick   10 and 100 tasks, and the start of one case

Wall-clock times, which hold on free cores alone.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

from driver.common.parallel import side_by_side

# What no task needs is imported where it is used: processes of tasks import this module.

_WORK = 0.02  # s of a task
_CASES = 8


def work(seconds: float) -> None:
    """Be at work for some time."""
    end = time.perf_counter() + seconds
    while time.perf_counter() < end:
        pass


def load(module: str) -> None:
    """Import a module."""
    import_module(module)


def overhead_of_tasks(number: int, processes: int) -> float:
    """Wall-clock time of each task beside its share of the work [s]."""
    begin = time.perf_counter()
    side_by_side(work, [_WORK] * number, processes)
    wall = time.perf_counter() - begin
    return (wall - number * _WORK / processes) / number


def start_of_refits(processes: int) -> float:
    """Wall-clock time until processes side by side have what a refit needs [s]."""
    begin = time.perf_counter()
    side_by_side(load, ["driver.diagnosis.search.refit"] * processes, processes)
    return time.perf_counter() - begin


def start_of_a_case() -> float:
    """Wall-clock time of a process that starts prismid and does nothing [s]."""
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-P", "-m", "driver.cli", "run", "--help"], check=True,
                   stdout=subprocess.DEVNULL)  # fmt: skip
    return time.perf_counter() - begin


def campaign(number: int) -> float:
    """Wall-clock time of each case of a campaign that only meshes [s]."""
    from driver.batch.command import batch
    from driver.case.model import write_case
    from tools.short_specimen import small_case

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


def main() -> None:
    """Run the study."""
    from benchmarks.measuring import show

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="end within 45 s")
    parser.add_argument("--growth", action="store_true", help="how costs grow, alone")
    arguments = parser.parse_args()
    quick = arguments.quick
    if arguments.growth:
        import_module("benchmarks.growth").show_all()
        return
    processes = os.cpu_count() or 1
    for number in (10, 100) if quick else (1, 10, 100, 1000):
        overhead = 1e3 * overhead_of_tasks(number, processes)
        show(f"{number} tasks of 20 ms on {processes} processes: overhead of each [ms]", overhead,
             "<= 50")  # fmt: skip
    show(f"start of {processes} processes that refit [s]", start_of_refits(processes))
    show("start of a process of prismid [s]", start_of_a_case())
    if not quick:
        show(f"campaign of {_CASES} cases that mesh: wall-clock time of each [s]",
             campaign(_CASES))  # fmt: skip
        import_module("benchmarks.cluster_plan").show_plan()
        import_module("benchmarks.growth").show_all()


if __name__ == "__main__":
    main()

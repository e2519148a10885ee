"""A campaign on a scheduler of Dask, in small, beside the plan of docs/batch.md."""

from __future__ import annotations

import time
from heapq import heapreplace
from typing import Any

import numpy as np
from distributed import Client, LocalCluster

from benchmarks.measuring import show
from meshes.arrays import FloatArray

_WORKERS = (8, 32)
_CASES = 1000


def planned(times: FloatArray, workers: int) -> float:
    """Return when the last of some cases ends, each beginning on the first worker that is free [s].

    Args:
        times: of the cases, in the order in which they begin, shape (n,) [s].
        workers: cases at a time.
    """
    free = [0.0] * workers
    for time_of_case in times:
        heapreplace(free, free[0] + float(time_of_case))
    return max(free)


def cluster_in_small(number: int, workers: int) -> tuple[float, float]:
    """Wall-clock time of a campaign on a scheduler of Dask, in small, and what the plan says [s].

    A case is a wait of a thirtieth part of a second for each minute; one in ten takes five times as
    long, for its meshes are refined. Waits, so that there may be more workers than cores.
    """
    rng = np.random.default_rng(1)
    times = 0.5 * rng.lognormal(0.0, 0.3, number) * np.where(rng.random(number) < 0.1, 5.0, 1.0)
    start: Any = LocalCluster
    connect: Any = Client
    with (
        start(n_workers=2, threads_per_worker=workers // 2, dashboard_address=":0") as cluster,
        connect(cluster) as client,
    ):
        client.gather(client.map(time.sleep, [0.0] * workers, pure=False))
        begin = time.perf_counter()
        client.gather(client.map(time.sleep, times.tolist(), pure=False))
        return time.perf_counter() - begin, planned(times, workers)


def show_plan() -> None:
    """Print how well the plan foresees a thousand cases."""
    for workers in _WORKERS:
        wall, foreseen = cluster_in_small(_CASES, workers)
        show(f"{_CASES} cases on {workers} workers of Dask, in small: time over that planned",
             wall / foreseen, "0.9 to 1.1")  # fmt: skip

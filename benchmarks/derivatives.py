"""What derivatives add to the cost of a forward run."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.measuring import (
    LARGE_SIZE,
    SMALL_SIZE,
    Run,
    in_child,
    show,
    show_parts,
    solve,
    warm,
)
from benchmarks.specimens import EIGHT, SHORT_CYCLES, THIRTY, beginning, specimen, stops


def sensitivity_runs(
    size: float, n_images: int, frees: Sequence[Sequence[str]], repeats: int
) -> list[Run]:
    """Return the best of a few runs with each set of free parameters."""
    warm("finite")
    simulations = [
        beginning(specimen(size, "finite", stops(SHORT_CYCLES), free), n_images) for free in frees
    ]
    forward_selection = [[solve(s) for s in simulations] for _ in range(repeats)]
    return [min(runs, key=lambda run: run.cpu) for runs in zip(*forward_selection, strict=True)]


def sensitivities(quick: bool) -> None:
    """Time what derivatives add to the forward run."""
    n_images, repeats = (5, 1) if quick else (15, 3)
    for size in (SMALL_SIZE,) if quick else (SMALL_SIZE, LARGE_SIZE):
        frees = ((), EIGHT, THIRTY)
        plain, *asked = in_child(sensitivity_runs, size, n_images, frees, repeats)
        show_parts(plain)
        for run, free, goal in zip(asked, frees[1:], ("<= 35", "<= 150"), strict=True):
            added = 100 * (run.cpu / plain.cpu - 1)
            show(f"{len(free)} sensitivities, {run.cells} cells, added cost [%]", added, goal)
            show_parts(run)

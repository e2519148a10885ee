"""What a simulation saves that begins its steps as a nearby one went."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.measuring import ALPHA_SIZE, in_child, show, warm
from benchmarks.specimens import SHORT_CYCLES, beginning, specimen, stops
from solver_adapters.bundled.adapter import BundledAdapter

CHANGES = (0.0, 0.005, 0.02, 0.1, 0.5)
"""Of τ0 and of the motion, one larger and the other one smaller."""


def iterations_beside(
    n_images: int, changes: tuple[float, ...]
) -> tuple[list[tuple[int, int]], float]:
    """Newton iterations beside a simulation and without it, and the largest change of a force."""
    warm("finite")
    solver = BundledAdapter()
    known = beginning(specimen(ALPHA_SIZE, "finite", stops(SHORT_CYCLES)), n_images)
    trajectory = solver.solve(known).trajectory
    counts, off = [], 0.0
    for change in changes:
        law = replace(known.material, tau0=(1 + change) * known.material.tau0)
        other = replace(known, material=law, motion=(1 - change) * known.motion)
        cold, near = solver.solve(other), solver.solve(replace(other, warm_start=trajectory))
        counts.append((near.iterations, cold.iterations))
        off = max(off, float(np.abs(near.force - cold.force).max() / np.abs(cold.force).max()))
    return counts, off


def nearby(quick: bool) -> None:
    """Count the iterations of a simulation whose neighbour is known."""
    n_images, changes = (5, CHANGES[2:3]) if quick else (46, CHANGES)
    counts, off = in_child(iterations_beside, n_images, changes)
    for change, (near, cold) in zip(changes, counts, strict=True):
        show(f"iterations beside a simulation {100 * change:g} % away [%]", 100 * near / cold)
    show("largest change of a force by that [of the largest force]", off, "<= 1e-6")

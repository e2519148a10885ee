"""Time of the crystal law alone, a point and a step."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.measuring import MEASURES, SCHEMES, in_child, show
from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import build_problem
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.interface import Integration
from solver_adapters.material import Material, StrainMeasure
from tools.boxes import ORIENTATIONS, box, pulled

REFERENCE = Path(__file__).parents[1] / "tests" / "data" / "solver" / "crystal_point.npz"
KERNEL_GOAL = {"small": 2.5, "finite": 6.0}  # µs


def kernel_time(measure: StrainMeasure, integration: Integration, repeats: int) -> float:
    """µs a point and step, tangent included, over the strain path of the reference point.

    The path is turned by about a degree, differently for each of 480 points.
    """
    with np.load(REFERENCE) as data:
        t, e = data[measure][:, :2].T
    bricks = pulled(box((2, 5, 2)), Material(strain_measure=measure), (0.0,))
    problem = build_problem(replace(bricks, integration=integration))
    points = problem.points
    n = points.grain.size
    vectors = np.random.default_rng(0).normal(scale=0.012, size=(n, 3))
    turns = np.stack([rotation_vector_matrix(vector) for vector in vectors])
    crystals = ORIENTATIONS[points.grain]
    paths = [
        (turns.transpose(0, 2, 1) @ _gradient(measure, x) @ turns @ crystals).reshape(n, 9)
        for x in e
    ]
    best = np.inf
    for _ in range(repeats + 1):  # the first one loads or compiles
        state, slips, total = problem.state, np.zeros((n, points.n_systems)), 0.0
        for row in range(1, len(t)):
            turned = row > 1 and (e[row] - e[row - 1]) * (e[row - 1] - e[row - 2]) < 0
            guess = np.zeros_like(slips) if turned else slips
            start = time.process_time()
            updated = points.update(paths[row], state, guess, float(t[row] - t[row - 1]))
            total += time.process_time() - start
            state, slips = updated.state, updated.slips
            if updated.iterations.min() < 0:
                raise RuntimeError(f"{measure} strain: a point did not converge in row {row}")
        best = min(best, total)
    return 1e6 * best / n / (len(t) - 1)


def kernel_times(repeats: int) -> dict[tuple[StrainMeasure, Integration], float]:
    """`kernel_time` of every strain measure and scheme."""
    return {(m, i): kernel_time(m, i, repeats) for i in SCHEMES for m in MEASURES}


def _gradient(measure: StrainMeasure, e: float) -> FloatArray:
    """Displacement gradient of the reference path."""
    if measure == "small":
        return e * np.diag([-0.5, -0.5, 1.0])
    stretch = np.exp(e)
    return np.diag([stretch**-0.5, stretch**-0.5, stretch]) - np.eye(3)


def kernels(quick: bool) -> None:
    """Time the crystal law alone."""
    for (measure, integration), value in in_child(kernel_times, 1 if quick else 6).items():
        goal = f"<= {KERNEL_GOAL[measure]:g}"
        show(f"kernel {measure} {integration} [us/point/step]", value, goal)

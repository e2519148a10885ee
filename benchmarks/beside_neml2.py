"""Time of the crystal law at material points beside NEML2, and how far both agree.

    python -m benchmarks.beside_neml2 PEERS/bin/python [--copies N]

PEERS is an environment of its own: `python -m venv PEERS` and
`PEERS/bin/pip install neml2==3.0.7 torch==2.12.1 numpy`. With torch 2.13.0, and NEML2 3.1.0 with
2.14.1, its Newton solver ends in an IndexError, in an example of its own tests as well.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.measuring import in_child, show
from meshes.arrays import FloatArray
from solver_adapters.bundled.fem.problem import build_problem
from solver_adapters.crystal import rotation_vector_matrix
from solver_adapters.material import Material
from tools.boxes import ORIENTATIONS, box, pulled

YOUNG, POISSON = 2e5, 0.3  # MPa, 1
STEPS, STRAIN, RATE = 50, 0.01, 1e-3  # up, and as many down; 1/s
REPEATS = 4  # the first one loads or compiles

Point = tuple[FloatArray, FloatArray, FloatArray, float]


def own() -> Point:
    """Strain and stress of 480 points in crystal axes, instants, and µs a point and step."""
    lame = YOUNG * POISSON / (1.0 + POISSON) / (1.0 - 2.0 * POISSON)
    shear = YOUNG / 2.0 / (1.0 + POISSON)
    material = Material(
        strain_measure="small", C11=lame + 2.0 * shear, C12=lame, C44=shear,
        tau0=1e-6, K=100.0, n=10.0, c=0.0, d=0.0, Q=0.0, b=0.0,
    )  # fmt: skip
    bricks = pulled(box((2, 5, 2)), material, (0.0,))
    problem = build_problem(replace(bricks, integration="backward_euler"))
    points, n = problem.points, problem.points.grain.size
    vectors = np.random.default_rng(0).normal(scale=0.012, size=(n, 3))
    turns = np.stack([rotation_vector_matrix(vector) for vector in vectors])
    crystals, up = ORIENTATIONS[points.grain], np.linspace(0.0, STRAIN, STEPS + 1)
    e = np.concatenate([up, up[-2::-1]])
    times = np.arange(len(e)) * STRAIN / STEPS / RATE
    strain = np.multiply.outer(e, turns.transpose(0, 2, 1) @ np.diag([-0.5, -0.5, 1.0]) @ turns)
    best = np.inf
    for _ in range(REPEATS):
        state, slips, total, stresses = problem.state, np.zeros((n, points.n_systems)), 0.0, []
        for row in range(1, len(e)):
            gradient = (strain[row] @ crystals).reshape(n, 9)
            guess = np.zeros_like(slips) if row == STEPS + 1 else slips
            start = time.process_time()
            updated = points.update(gradient, state, guess, float(times[row] - times[row - 1]))
            total += time.process_time() - start
            if updated.iterations.min() < 0:
                raise RuntimeError(f"a point did not converge in row {row}")
            state, slips = updated.state, updated.slips
            # The stress goes with the gradient times the crystal rotation: one side is turned.
            stresses.append(crystals.transpose(0, 2, 1) @ updated.P.reshape(n, 3, 3))
        best = min(best, total)
    inside = crystals.transpose(0, 2, 1) @ strain @ crystals
    return inside, np.array(stresses), times, 1e6 * best / n / (len(e) - 1)


def beside(python: str, copies: int) -> None:
    """Print both times, their ratio and the largest difference of the stresses."""
    strain, stress, times, cpu = in_child(own)
    with tempfile.TemporaryDirectory() as folder:
        path, answer = Path(folder) / "path.npz", Path(folder) / "stress.npz"
        np.savez(path, strain=np.tile(strain, (1, copies, 1, 1)), time=times)
        script = Path(__file__).with_name("neml2_point.py")
        command = [python, str(script), str(path), str(answer)]
        told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
        with np.load(answer) as data:
            off = np.abs(data["stress"][:, : strain.shape[1]] - stress).max()
    show("prismid, tangent included [us/point/step]", cpu)
    show(f"NEML2, {copies * strain.shape[1]} points, no tangent [us/point/step]", float(told))
    show("NEML2 over prismid", float(told) / cpu)
    show("largest difference of the stress over the largest stress", off / np.abs(stress).max())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("python", help="interpreter of the environment with NEML2")
    parser.add_argument("--copies", type=int, default=1, help="of the 480 points, for NEML2")
    arguments = parser.parse_args()
    beside(arguments.python, arguments.copies)

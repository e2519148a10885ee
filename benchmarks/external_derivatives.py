"""Derivatives of CalculiX by differences, beside those of the bundled solver, which are exact.

    python -m benchmarks.external_derivatives 5 20

Both solvers take the same steps of backward Euler on the same mesh, with four points in a cell.
What remains between them is what differences make wrong, and CalculiX's own solution at a point.
The argument is the number of time steps between two rows of the history, one or several.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.identify_external import small_case
from driver.forward.build import build_model, mesh_of
from driver.virtual.truth import stage_program
from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.finite_differences import FiniteDifferences
from solver_adapters.interface import Response, Simulation

ASKED = {
    "lambda_plus_Y": 0.85, "lambda_plus_Z": 1.0, "lambda_minus_Y": 0.78, "lambda_minus_Z": 1.0,
    "elongation_1": 0.0506, "elongation_2": 0.0469, "tilt_1": 0.0147, "tilt_2": 0.0129,
    "tau0": 25.0, "c": 44e3, "d": 1140.0,
}  # fmt: skip
"""Parameters and where they stand, about the result of `benchmarks.identify_external`."""


def asked_simulation(steps: int) -> Simulation:
    """Return the simulation of a case, with all of its directions.

    Args:
        steps: time steps between two rows of the history.
    """
    case = small_case()
    mesh = mesh_of(case, case.specimen.mesh_size)
    history = stage_program([(7, 3)])
    model = build_model(case, mesh, history, np.zeros((0, 2)), CalculixAdapter(), steps)
    return replace(model.simulation(model.null_values() | ASKED, list(ASKED)), tet10_points=4)


def deviation(found: Response, exact: Response, row: int) -> float:
    """Return by how much a derivative differs from the exact one, in shares of it."""
    norms = np.linalg.norm(exact.displacement), np.linalg.norm(exact.force)

    def size(displacement: FloatArray, force: FloatArray) -> float:
        return float(
            np.hypot(np.linalg.norm(displacement) / norms[0], np.linalg.norm(force) / norms[1])
        )

    u, f = exact.d_displacement[row], exact.d_force[row]
    return size(found.d_displacement[row] - u, found.d_force[row] - f) / size(u, f)


def main() -> None:
    """Print the deviation along each direction, and what was told of it."""
    if shutil.which("ccx") is None:
        sys.exit("there is no ccx on the PATH (package calculix-ccx)")
    for steps in map(int, sys.argv[1:] or ["20"]):
        asked = asked_simulation(steps)
        with tempfile.TemporaryDirectory() as folder:
            solver = FiniteDifferences(CalculixAdapter(), processes=2)
            found = solver.solve(asked, Path(folder))
            runs = len(list(Path(folder).iterdir()))
        exact = BundledAdapter().solve(replace(asked, steps=found.ends))
        print(f"{steps} steps: {runs} runs, {found.steps} steps taken, {found.cuts} of them cut")
        for row, direction in enumerate(asked.directions):
            told = [note for note in found.notes if f"'{direction.name}'" in note]
            doubt = "called doubtful" if told else ""
            print(f"  {direction.name}: {deviation(found, exact, row):.2%} {doubt}".rstrip())
        for note in found.notes:
            print(f"  {note}")


if __name__ == "__main__":
    main()

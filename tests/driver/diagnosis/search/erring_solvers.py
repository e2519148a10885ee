"""Solvers in closed form that err, or fail, where the grains differ."""

from __future__ import annotations

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation
from tools import closed_form


class ErringWithContrast(closed_form.ClosedFormSolver):
    """A working mesh that bends the face where the grains differ, as no specimen does."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        x = simulation.mesh.points[simulation.output_nodes, 0]
        grown = np.linspace(0.0, 0.0025 * np.log(simulation.material.tau0_grain2), len(motion))
        motion[..., 2] += grown[:, None] * x**2
        return motion, load


class Failing(closed_form.ClosedFormSolver):
    def __init__(self, error: Exception) -> None:
        super().__init__()
        self.error = error

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        raise self.error

"""The solver that ships with prismid, behind the common interface."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from solver_adapters.bundled.problem import build_problem, build_tangents
from solver_adapters.bundled.stepping import Stepper
from solver_adapters.interface import (
    Capabilities,
    Progress,
    Response,
    Simulation,
    UnsupportedError,
)
from solver_adapters.material import MATERIAL_PARAMETERS

FloatArray = NDArray[np.float64]


class BundledAdapter:
    """Crystal plasticity on ten-node tetrahedra, small or finite strain, exact derivatives."""

    name = "bundled"

    def capabilities(self) -> Capabilities:
        """All parameters of the law, both strain measures, derivatives."""
        return Capabilities(
            material=frozenset(MATERIAL_PARAMETERS),
            strain_measures=frozenset(("small", "finite")),
            derivatives=True,
        )

    def version(self) -> str:
        """Hash of the sources of the solver."""
        digest = hashlib.sha256()
        for source in sorted(Path(__file__).parent.glob("*.py")):
            digest.update(source.read_bytes())
        return digest.hexdigest()[:12]

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run a simulation in this process; nothing is written.

        Raises:
            UnsupportedError: a constant is not positive or the stiffness is not positive definite.
            SolverError: a step could not be solved; the message says where.
        """
        _refuse_bad_constants(simulation)
        problem = build_problem(simulation)
        tangents = build_tangents(simulation, problem)
        stepper = Stepper(problem, tangents, simulation.tolerance)
        times, wanted = simulation.times, np.asarray(simulation.output)
        position = {int(index): row for row, index in enumerate(wanted)}
        nodes, k = simulation.output_nodes, tangents.count
        displacement = np.zeros((wanted.size, nodes.size, 3))
        force = np.zeros(wanted.size)
        d_displacement = np.zeros((k, wanted.size, nodes.size, 3))
        d_force = np.zeros((k, wanted.size))

        def motion(instant: float) -> FloatArray:
            return _interpolate(instant, times, problem.motion)

        def motion_tangent(instant: float) -> FloatArray:
            return _interpolate(instant, times, tangents.motion)

        frame = stepper.start(float(times[0]))
        for index in range(1, len(times)):
            frame = stepper.advance(
                frame, float(times[index]), motion, motion_tangent, simulation.steps_per_interval
            )
            row = position.get(index)
            if row is not None:
                displacement[row] = frame.u[nodes]
                force[row] = frame.force
                d_displacement[:, row] = frame.du[nodes].transpose(2, 0, 1)
                d_force[:, row] = frame.dforce
            if progress is not None:
                s = stepper.statistics
                progress(Progress(frame.time, float(times[-1]), s.steps, s.iterations, s.cuts))
        s = stepper.statistics
        return Response(
            displacement, force, d_displacement, d_force, s.steps, s.iterations, s.cuts, s.seconds
        )


def _interpolate(instant: float, times: FloatArray, values: FloatArray) -> FloatArray:
    index = int(np.clip(np.searchsorted(times, instant), 1, len(times) - 1))
    weight = (instant - times[index - 1]) / (times[index] - times[index - 1])
    return np.asarray((1 - weight) * values[index - 1] + weight * values[index])


def _refuse_bad_constants(simulation: Simulation) -> None:
    m = simulation.material
    for name in ("C44", "K", "n", "tau0", "tau0_112", "tau0_grain2", "elastic_scale", "C44_scale"):
        if not 0 < getattr(m, name) < np.inf:
            raise UnsupportedError(f"{name} is {getattr(m, name):g}; expected a positive number")
    for name in ("c", "d", "Q", "b"):
        if not 0 <= getattr(m, name) < np.inf:
            raise UnsupportedError(f"{name} is {getattr(m, name):g}; expected zero or more")
    if not (abs(m.C12) < m.C11 < np.inf and m.C11 + 2 * m.C12 > 0):
        raise UnsupportedError(
            f"C11 = {m.C11:g}, C12 = {m.C12:g} MPa do not make a positive definite stiffness; "
            "expected C11 > |C12| and C11 + 2 C12 > 0"
        )

"""The solver that ships with prismid, behind the common interface."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled import restart
from solver_adapters.bundled.direction_reduction import reduced_directions
from solver_adapters.bundled.fem.cell_fields import cell_fields, widths
from solver_adapters.bundled.fem.problem import Problem, build_problem, build_tangents
from solver_adapters.bundled.identity import solver_hash
from solver_adapters.bundled.stepping import Stepper
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.interface import (
    Capabilities,
    CellFields,
    Progress,
    Response,
    Simulation,
    SolverError,
    Trajectory,
    UnfinishedError,
)
from solver_adapters.material import MATERIAL_PARAMETERS
from solver_adapters.simulation_key import simulation_key
from solver_adapters.time_steps import between_instants, step_ends

_BETWEEN_CHECKPOINTS = 60.0  # s
_BETWEEN_KEPT = 1.0  # s; beside its interval an interruption may lose so much


class BundledAdapter:
    """Crystal plasticity on quadratic tetrahedra or hexahedra, exact derivatives."""

    name = "bundled"

    def capabilities(self) -> Capabilities:
        """All parameters of the law, strain measures and schemes, derivatives, cell fields."""
        return Capabilities(
            material=frozenset((*MATERIAL_PARAMETERS, "slip_systems")),
            strain_measures=frozenset(("small", "finite")),
            derivatives=True,
            cell_fields=True,
            lattice_gradient=True,
            times=True,
            accuracy=True,
            cells=frozenset((10, 20)),
            tet10_points=frozenset((4, 5)),
            mean_dilatation=True,
            integrations=frozenset(("exponential", "backward_euler")),
            in_process=True,
            # Its checkpoints are for one run at a time, and its runs are short.
            uses_workspace=False,
        )

    def version(self) -> str:
        """Hash of the sources of the solver and of the versions of its libraries."""
        return solver_hash()[:12]

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run a simulation in this process.

        With a workspace the state is written there from time to time and on Ctrl-C, and a later
        call with the same simulation goes on from it, to answers within the tolerance of equal.

        Raises:
            UnsupportedError: a value cannot be honoured, see `refuse_bad_simulation`.
            BadSimulationError: the input is broken, see there.
            UnfinishedError: a step could not be solved; the message says where.
        """
        refuse_bad_simulation(simulation)
        key = simulation_key(simulation, self.version()) if workspace else ""
        checkpoint = restart.read(workspace, key) if workspace else None
        fewer = reduced_directions(simulation)
        run = Run(fewer.simulation, build_problem(fewer.simulation), checkpoint)
        begun = written = time.monotonic()
        first, last = run.index, len(simulation.times) - 1
        try:
            while run.index < last:
                run.advance()
                now = time.monotonic()
                if progress is not None:
                    s = run.stepper.statistics
                    done, left = run.index - first, last - run.index
                    if done == 1:
                        begun = now  # the first interval may have compiled kernels
                    known = (now - begun) * left / (done - 1) if done > 1 else math.nan
                    progress(
                        Progress(
                            float(simulation.times[run.index]),
                            float(simulation.times[-1]),
                            s.steps,
                            s.iterations,
                            s.cuts + s.refinements,
                            known if left else 0.0,
                        )
                    )
                if workspace and now - written > _BETWEEN_CHECKPOINTS:
                    restart.write(workspace, key, run.checkpoint)
                    written = time.monotonic()
        except SolverError as error:
            reached = fewer.whole(run.response())
            raise UnfinishedError(str(error), reached, run.index) from None
        except KeyboardInterrupt:
            if workspace:
                restart.write(workspace, key, run.checkpoint)
            raise
        if workspace:
            (workspace / restart.FILE).unlink(missing_ok=True)
        return fewer.whole(run.response())


class Run:
    """A simulation on its way from instant to instant.

    Attributes:
        index: the last instant reached.
    """

    def __init__(
        self,
        simulation: Simulation,
        problem: Problem,
        checkpoint: restart.Checkpoint | None = None,
    ) -> None:
        self.simulation = simulation
        self.problem = problem
        self.tangents = build_tangents(simulation, problem)
        self.stepper = Stepper(
            self.problem,
            self.tangents,
            simulation.tolerance,
            simulation.accuracy,
            simulation.cell_fields,
            simulation.warm_start,
        )
        self._ends = step_ends(simulation, simulation.steps_per_interval)
        self._row = {int(index): row for row, index in enumerate(simulation.output)}
        n, nodes = len(simulation.output), simulation.output_nodes.size
        k = self.tangents.count
        self._rows = {
            "displacement": np.zeros((n, nodes, 3)),
            "force": np.zeros(n),
            "d_displacement": np.zeros((k, n, nodes, 3)),
            "d_force": np.zeros((k, n)),
        }
        if simulation.cell_fields:
            cells, width = len(simulation.mesh.cells), widths(problem.points.n_systems)
            self._rows |= {name: np.zeros((n, cells, k)) for name, k in width.items()}
        times = simulation.times
        self._start = self.stepper.start(float(times[0]))
        if checkpoint is not None and restart.fits(
            checkpoint, self._start, self._rows, times, self.problem.prescribed.size
        ):
            self.index, self._instant = checkpoint.index, checkpoint.instant
            self._rows = checkpoint.rows
            self.stepper.resume(
                checkpoint.last, checkpoint.ends, checkpoint.course, checkpoint.counts
            )
        else:
            self.index, self._instant = 0, self._start
            self._book()
        self._kept, self._kept_at, self._under_way = self._at_instant(), -math.inf, False

    @property
    def checkpoint(self) -> restart.Checkpoint:
        """What is needed to go on: from the last instant, within an interval from one before it."""
        return self._kept if self._under_way else self._at_instant()

    def advance(self) -> None:
        """Go to the next instant."""
        if time.monotonic() - self._kept_at > _BETWEEN_KEPT:
            # Not more often: derivatives that are kept have to be copied before they are changed.
            self._kept, self._kept_at = self._at_instant(), time.monotonic()
            self.stepper.keep(self._instant)
        self._under_way = True
        s = self.simulation
        begin, end = s.times[self.index], s.times[self.index + 1]
        ends = self._ends[(self._ends > begin) & (self._ends <= end)]
        self._instant = self.stepper.advance(
            self._instant,
            ends,
            self._motion,
            self._motion_tangent,
            self.tangents.law_over(self.index),
        )
        self.index += 1
        self._book()
        self._under_way = False

    def _at_instant(self) -> restart.Checkpoint:
        """Return what is needed to go on from the last instant."""
        s = self.stepper.statistics
        return restart.Checkpoint(
            self.index,
            self._instant,
            dict(self.stepper.last),
            self._rows,
            list(s.ends),
            list(self.stepper.course),
            (s.steps, s.iterations, s.cuts, s.refinements),
        )

    def response(self) -> Response:
        """Return the outputs that have been reached."""
        s = self.stepper.statistics
        done = sum(index <= self.index for index in self._row)
        rows = self._rows
        cells = None
        if self.simulation.cell_fields:
            cells = CellFields(**{f.name: rows[f.name][:done] for f in fields(CellFields)})
        return Response(
            rows["displacement"][:done],
            rows["force"][:done],
            rows["d_displacement"][:, :done],
            rows["d_force"][:, :done],
            s.steps,
            s.iterations,
            s.cuts,
            s.refinements,
            np.array(s.ends),
            s.seconds,
            cells,
            trajectory=Trajectory(
                np.array([self._start.time, *s.ends]),
                np.stack([self._start.u, *self.stepper.course]),
            ),
        )

    def _book(self) -> None:
        """Keep what is wanted at this instant; displacements count from the first instant."""
        row = self._row.get(self.index)
        if row is None:
            return
        nodes, instant = self.simulation.output_nodes, self._instant
        start = self._start
        self._rows["displacement"][row] = (instant.u - start.u)[nodes]
        self._rows["force"][row] = instant.force
        self._rows["d_displacement"][:, row] = (instant.du - start.du)[nodes].transpose(2, 0, 1)
        self._rows["d_force"][:, row] = instant.dforce
        if self.simulation.cell_fields:
            for name, values in cell_fields(self.problem, start, instant).items():
                self._rows[name][row] = values

    def _motion(self, instant: float) -> FloatArray:
        return between_instants(instant, self.simulation.times, self.problem.motion)

    def _motion_tangent(self, instant: float) -> FloatArray:
        return between_instants(instant, self.simulation.times, self.tangents.motion)

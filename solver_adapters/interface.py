"""The words that driver and solvers share: Simulation in, Response out."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from meshes.arrays import BoolArray, FloatArray, IntArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.material import Material

Integration = Literal["backward_euler", "exponential"]


class SolverError(Exception):
    """A simulation that cannot be carried to its end; the message says where and what helps."""


class UnfinishedError(SolverError):
    """A simulation that stopped on its way.

    Attributes:
        response: what was reached: the rows of the outputs up to and including `reached`.
        reached: index into `Simulation.times` of the last instant that was reached.
    """

    def __init__(self, message: str, response: Response, reached: int) -> None:
        # All of them, so that it can be sent between processes.
        super().__init__(message, response, reached)
        self.response = response
        self.reached = reached

    def __str__(self) -> str:
        return str(self.args[0])


class UnsupportedError(SolverError):
    """A parameter, option or direction that this adapter cannot honour."""


class BadSimulationError(SolverError):
    """A simulation that contradicts itself or that no solver could run."""


class NotRunError(SolverError):
    """A simulation that was not run, for a reason that other parameters would not mend."""


class PreparedError(NotRunError):
    """Jobs that were written for another machine instead of being run.

    Attributes:
        folders: the folders of the jobs, each complete.
    """

    def __init__(self, folders: Sequence[Path]) -> None:
        super().__init__(tuple(folders))
        self.folders = tuple(folders)

    @classmethod
    def together(cls, errors: Sequence[PreparedError]) -> PreparedError:
        """Of the folders of all, each once."""
        return cls(list(dict.fromkeys(folder for error in errors for folder in error.folders)))

    def __str__(self) -> str:
        listed = "".join(f"\n  {folder}" for folder in self.folders)
        return (
            f"{len(self.folders)} job(s) are ready to be computed elsewhere, each as its "
            f"README.txt says; `prismid run` then goes on from their results:{listed}"
        )


@dataclass(frozen=True, eq=False)
class Direction:
    """A tangent in the space of simulations, along which the response is differentiated.

    Attributes:
        name: label of the direction, unique in a simulation.
        material: derivative of each named field of `Material`.
        rotation: derivative of the rotation vector of each grain [rad], specimen frame
            (the crystal turns by R ← exp(rotation) R), shape (n_grains, 3), or None.
        lattice_gradient: derivative of `Simulation.lattice_gradient` [rad/µm],
            shape (n_grains, 3), or None.
        motion: derivative of the prescribed motion [µm], shape of `Simulation.motion`, or None.
        points: derivative of the node coordinates [µm], shape (n_nodes, 3), or None.
        times: derivative of `Simulation.times` [s], shape (n_times,), or None; the ends of time
            steps between two instants keep their share of the interval.
        scale: an amount along the direction that is a typical change; finite differences step
            by a small share of it.
    """

    name: str
    material: Mapping[str, float] = field(default_factory=dict)
    rotation: FloatArray | None = None
    lattice_gradient: FloatArray | None = None
    motion: FloatArray | None = None
    points: FloatArray | None = None
    times: FloatArray | None = None
    scale: float = 1.0


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The trajectory of a simulation.

    Attributes:
        times: the first instant and the ends of its time steps [s], increasing, shape (n,).
        displacement: of all nodes there [µm], shape (n, n_nodes, 3); at the first instant that of
            an eigenstrain.
    """

    times: FloatArray
    displacement: FloatArray


@dataclass(frozen=True, eq=False)
class Simulation:
    """Everything that a solver needs, as one value.

    Attributes:
        mesh: the specimen, µm.
        material: constants of the law, MPa and s.
        orientations: crystal → specimen rotation of each grain (columns are the crystal axes
            in the specimen frame), shape (n_grains, 3, 3).
        times: instants of the loading history [s], increasing, shape (n_times,); motion is
            linear between them.
        motion_nodes: nodes whose motion is prescribed, shape (n_moved,).
        motion_mask: which components of them are prescribed, shape (n_moved, 3).
        motion: their displacement [µm] (ignored where the mask is false),
            shape (n_times, n_moved, 3).
        output: indices into `times` at which results are wanted, shape (n_output,).
        output_nodes: nodes whose displacement is wanted, shape (n_output_nodes,).
        directions: tangents for which derivatives are wanted.
        lattice_gradient: how the crystal of each grain turns along Y, as a rotation vector in the
            specimen frame for each µm from the centroid of the grain [rad/µm],
            shape (n_grains, 3), or None for lattices without gradient.
        integration: how the law is integrated over a time step: "backward_euler", as other codes
            do, or "exponential", which follows back stress and relaxation exactly.
        steps_per_interval: smallest number of time steps between two instants.
        accuracy: error of the force that a time step may make [µN], by which steps are refined;
            it is estimated from back stress and overstress, not from isotropic hardening. None
            for the steps as given.
        steps: ends of the time steps [s], increasing, after the first instant and through every
            other one, to be taken as they are (the steps of an earlier `Response`), or None; all
            solvers take those of `time_steps.step_ends`.
        tolerance: largest ratio of the residual to the reaction at convergence.
        cell_fields: whether stress, slips and lattice rotation of the cells are wanted.
        tet10_points: Gauss points of a tetrahedron of ten nodes, 4 or 5, or None for those that
            the solver takes by itself.
        mean_dilatation: whether the dilatation of a cell is projected on few functions, against
            locking where plastic flow keeps the volume: its mean in a tetrahedron, a linear
            function in a hexahedron.
        warm_start: the trajectory of a simulation of this mesh with other parameters, by which a
            solver may begin its iterations; in the same time steps no result depends on it by more
            than `tolerance`.
    """

    mesh: PrismMesh
    material: Material
    orientations: FloatArray
    times: FloatArray
    motion_nodes: IntArray
    motion_mask: BoolArray
    motion: FloatArray
    output: IntArray
    output_nodes: IntArray
    directions: tuple[Direction, ...] = ()
    lattice_gradient: FloatArray | None = None
    integration: Integration = "exponential"
    steps_per_interval: int = 1
    accuracy: float | None = None
    steps: FloatArray | None = None
    tolerance: float = 1e-7
    cell_fields: bool = False
    tet10_points: int | None = None
    mean_dilatation: bool = False
    warm_start: Trajectory | None = None


@dataclass(frozen=True)
class Progress:
    """State of a running simulation.

    Attributes:
        time: simulated time reached [s].
        end: simulated time at the end [s].
        steps: time steps taken, 0 of a solver that does not tell them on its way.
        iterations: Newton iterations in all.
        cuts: steps that had to be cut, for convergence or for accuracy.
        remaining: wall-clock time to the end at the speed so far [s], NaN while it is not known.
        run: number of the run, from 1, where one answer takes several.
        runs: how many there are to be, as far as it is known.
        holder: who runs the same simulation, where its end is waited for, in words; else "".
    """

    time: float
    end: float
    steps: int
    iterations: int
    cuts: int
    remaining: float = math.nan
    run: int = 1
    runs: int = 1
    holder: str = ""


@dataclass(frozen=True, eq=False)
class CellFields:
    """Means over the cells at the output instants.

    Attributes:
        stress: Cauchy stress [MPa] in the order XX, YY, ZZ, YZ, XZ, XY, specimen frame,
            shape (n_output, n_cells, 6).
        slip: signed slip of each system since the start, shape (n_output, n_cells, n_systems) with
            `crystal.system_count` of the slip systems: 24, or 48 of a crystal that has more.
        accumulated_slip: the same without signs, shape (n_output, n_cells, n_systems).
        rotation: rotation vector of the lattice since the start [rad], specimen frame,
            shape (n_output, n_cells, 3).
    """

    stress: FloatArray
    slip: FloatArray
    accumulated_slip: FloatArray
    rotation: FloatArray


@dataclass(frozen=True, eq=False)
class Response:
    """What a solver answers.

    Attributes:
        displacement: [µm], shape (n_output, n_output_nodes, 3).
        force: force along Y on the face S_PLUS [µN], shape (n_output,).
        d_displacement: derivative of the displacement along each direction,
            shape (n_directions, n_output, n_output_nodes, 3).
        d_force: derivative of the force, shape (n_directions, n_output).
        steps: time steps taken.
        iterations: Newton iterations in all.
        cuts: steps that had to be cut to converge.
        refinements: steps that had to be cut for `Simulation.accuracy`.
        ends: ends of the time steps taken [s], shape (steps,).
        seconds: wall-clock time by component [s], of the last part of a run that was resumed.
        cells: fields of the cells where `Simulation.cell_fields` asks for them, else None.
        notes: sentences on what the user should know of this answer.
        trajectory: the trajectory that the simulation took, None of a solver that does not tell it.
    """

    displacement: FloatArray
    force: FloatArray
    d_displacement: FloatArray
    d_force: FloatArray
    steps: int = 0
    iterations: int = 0
    cuts: int = 0
    refinements: int = 0
    ends: FloatArray = field(default_factory=lambda: np.zeros(0))
    seconds: Mapping[str, float] = field(default_factory=dict)
    cells: CellFields | None = None
    notes: tuple[str, ...] = ()
    trajectory: Trajectory | None = None


@dataclass(frozen=True)
class Capabilities:
    """What an adapter can honour.

    Attributes:
        material: names of the material parameters that may leave their null value.
        strain_measures: the strain measures on offer.
        derivatives: whether directions are answered.
        cell_fields: whether fields of the cells are answered.
        noise: by what share force and displacement scatter between runs of nearly the same
            simulation: the tolerance of the iteration, or the digits of a result file. Finite
            differences choose their steps by it.
        cost: CPU time of the law at the Gauss points over that of the bundled solver, roughly, for
            estimates.
        start: CPU time of a simulation before its first time step [s], roughly, for estimates.
        integrations: the schemes of time integration on offer.
        conditional: names of further material parameters of which some values besides the null
            are honoured; the adapter judges the value, and they cannot be identified.
        cautions: a sentence for the user who chooses a strain measure, by its name.
        lattice_gradient: whether lattices with a gradient are honoured.
        times: whether directions along the instants are answered.
        accuracy: whether steps are refined to a stated error of the force.
        cells: the kinds of cells on offer, by their number of nodes.
        tet10_points: the numbers of Gauss points of a tetrahedron of ten nodes on offer.
        mean_dilatation: whether `Simulation.mean_dilatation` is honoured.
        least_steps: time steps between two instants below which the solver errs by more than its
            scheme does.
        runs_per_direction: simulations that a direction costs beside the asked one: none for a
            solver with derivatives of its own, some where they are differences of runs.
        in_process: whether it simulates inside prismid, without a program of its own.
        uses_workspace: whether it keeps files of its runs in the folder that `solve` names.
    """

    material: frozenset[str]
    strain_measures: frozenset[str]
    derivatives: bool
    cell_fields: bool = False
    noise: float = 1e-5
    cost: float = 1.0
    start: float = 0.0
    integrations: frozenset[str] = frozenset(("backward_euler",))
    conditional: frozenset[str] = frozenset()
    cautions: Mapping[str, str] = field(default_factory=dict)
    lattice_gradient: bool = False
    times: bool = False
    accuracy: bool = False
    cells: frozenset[int] = frozenset((10,))
    tet10_points: frozenset[int] = frozenset()
    mean_dilatation: bool = False
    least_steps: int = 1
    runs_per_direction: int = 0
    in_process: bool = False
    uses_workspace: bool = True


class Adapter(Protocol):
    """A solver that prismid can call."""

    name: str

    def capabilities(self) -> Capabilities:
        """Return what this solver can honour."""
        ...

    def version(self) -> str:
        """Identity of the solver, part of the job key."""
        ...

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run the simulation.

        Args:
            simulation: what to solve.
            workspace: a folder for files of the run, from which a stopped run may go on.
            progress: called as the run advances.

        Raises:
            UnsupportedError: the simulation asks for what this solver cannot honour.
            UnfinishedError: the run stopped on its way; what was reached is in it.
            NotRunError: the solver is absent, or the run was prepared for another machine.
            SolverError: the run could not be made.
        """
        ...

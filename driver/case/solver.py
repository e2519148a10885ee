"""The solver, its time steps, and the use of the machine."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from driver.case.values import Count, Few, NewFolder, OwnFolder, Positive, Table
from solver_adapters.interface import Integration


class ProfileTable(Table):
    """How the program of a solver is called; what is not given here is asked elsewhere."""

    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None, description="a list of texts, the program and its leading arguments"
    )
    processes: Few | None = Field(default=None, description="MPI processes of a job")
    threads: Few | None = Field(default=None, description="threads of each process")
    memory_MB: Positive | None = Field(default=None, description="memory limit of a job")
    wall_time_s: Positive | None = Field(default=None, description="limit of the wall-clock time")
    cpu_time_s: Positive | None = Field(
        default=None, description="limit of the CPU time of all processes of a job together"
    )


class Solver(Table):
    """The solver and its time steps."""

    name: str = Field(
        default="bundled", description="a text in quotes, the name of a solver adapter"
    )
    integration: Integration | None = Field(
        default=None,
        description='"exponential" or "backward_euler", how the law is integrated over a time step',
    )
    steps_per_interval: Count = Field(
        default=1, description="time steps between two rows of the history"
    )
    fine_steps_per_interval: Count = Field(
        default=2, description="the same in finer steps, which tell what those leave wrong"
    )
    accuracy_uN: Positive | None = Field(
        default=None,
        description="error of the force that a time step may make, by which steps are refined",
    )
    gauss_points: Literal[4, 5] | None = Field(
        default=None,
        description="Gauss points of a tetrahedron, 4 or 5, of a solver that has the choice",
    )
    mean_dilatation: bool | None = Field(
        default=None,
        description="true or false, whether cells follow plastic flow, which keeps the volume, "
        "without locking; default true with hexahedra, false with tetrahedra",
    )
    profiles: dict[str, ProfileTable] = Field(
        default_factory=dict, description="how the program of a solver is called, by its name"
    )


class Execution(Table):
    """Use of the machine."""

    processes: Few = Field(default=2, description="simulations side by side")
    threads: Few = Field(default=1, description="threads of each process")
    scheduler: str | None = Field(
        default=None,
        description='a text in quotes, the address of a Dask scheduler, as "tcp://host:8786", '
        "whose workers simulate side by side",
    )
    budget_min: Positive = Field(
        default=120.0,
        description="minutes of all stages up to the diagnosis, within which automatic meshes are "
        "refined",
    )
    results: OwnFolder = Field(
        default="results",
        description="a text in quotes, the name of the folder of the results, beside the case",
    )
    store: NewFolder | None = Field(
        default=None,
        description="a text in quotes, the folder of the jobs of a solver that is a program of its "
        "own; cases may share it",
    )

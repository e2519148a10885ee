"""What time stepping carries from step to step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.crystal import SYSTEM_COUNTS


@dataclass(frozen=True, eq=False)
class Increment:
    """A converged step, kept as the start of a later step of the same kind.

    Attributes:
        du: displacement increment, (n_nodes, 3).
        slips: slips of the step, (n_points, n_systems).
        motion: increment of the prescribed motion, (n_prescribed,).
        dt: length [s].
        near: what a nearby simulation did over that time [µm], (n_nodes, 3), null without one.
    """

    du: FloatArray
    slips: FloatArray
    motion: FloatArray
    dt: float
    near: FloatArray


@dataclass(frozen=True, eq=False)
class Instant:
    """State at an instant, and its derivatives along k directions.

    Attributes:
        time: the instant [s].
        u: displacement [µm], (n_nodes, 3).
        H: displacement gradients times the crystal rotations, (n_points, 9).
        state: states of the Gauss points, (n_points, n_state).
        force: force on the pulled face [µN].
        du: derivative of the displacement, (n_nodes, 3, k).
        dstate: derivative of the states, (n_points, n_derived, k); gone with the next step
            unless the instant is kept (`Stepper.keep`).
        dforce: derivative of the force, (k,).
        slip: signed slip since the start, (n_points, n_systems), or (0, n_systems) where no cell
            fields are wanted.
        P: first Piola–Kirchhoff stress times the crystal rotations [MPa], (n_points, 9), or
            (0, 9) likewise.
    """

    time: float
    u: FloatArray
    H: FloatArray
    state: FloatArray
    force: float
    du: FloatArray
    dstate: FloatArray
    dforce: FloatArray
    slip: FloatArray = field(default_factory=lambda: np.zeros((0, SYSTEM_COUNTS[0])))
    P: FloatArray = field(default_factory=lambda: np.zeros((0, 9)))

"""The forward model: parameters in, what images and load cell should show out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from driver.boundary import (
    BOUNDARY_DECLARATIONS,
    BoundaryMotion,
    knot_declarations,
)
from driver.instrument import IMAGE_DECLARATIONS, LOAD_DECLARATIONS, Instrument
from driver.microstructure import (
    GEOMETRY_DECLARATIONS,
    ORIENTATION_DECLARATIONS,
    Microstructure,
)
from driver.surface_view import POSE_DECLARATIONS, Look, SurfaceView, apply
from solver_adapters.interface import (
    Adapter,
    Direction,
    Integration,
    Progress,
    Response,
    Simulation,
)
from solver_adapters.material import (
    MATERIAL_DECLARATIONS,
    MATERIAL_PARAMETERS,
    Material,
    with_parameters,
)
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Values = Mapping[str, float]


def declared_parameters(n_knots: int) -> dict[str, Parameter]:
    """Every parameter of the general model by name."""
    declared = (
        *MATERIAL_DECLARATIONS,
        *BOUNDARY_DECLARATIONS,
        *knot_declarations(n_knots),
        *GEOMETRY_DECLARATIONS,
        *ORIENTATION_DECLARATIONS,
        *LOAD_DECLARATIONS,
        *IMAGE_DECLARATIONS,
        *POSE_DECLARATIONS,
    )
    return {parameter.name: parameter for parameter in declared}


@dataclass(frozen=True, eq=False)
class Prediction:
    """What the model expects, T images, n surface nodes, k free parameters.

    Attributes:
        surface: motion of the surface nodes as the images show it [µm], shape (T, n, 3).
        load: load reading [µN], shape (T,).
        d_surface: derivative for each free parameter, shape (k, T, n, 3).
        d_load: derivative of the load, shape (k, T).
        carried: what the images see besides, where a parameter moves the surface under the
            pixels: derivative of the motion at the pixels by index of the parameter,
            each of shape (T, n_pix, 3).
        look: operators from the nodes to the pixels.
        response: statistics and raw fields of the solver.
    """

    surface: FloatArray
    load: FloatArray
    d_surface: FloatArray
    d_load: FloatArray
    carried: Mapping[int, FloatArray]
    look: Look
    response: Response

    def restrict(self, rows: Sequence[int]) -> Prediction:
        """The prediction with the derivatives of some of its parameters, in the given order."""
        carried = {new: self.carried[old] for new, old in enumerate(rows) if old in self.carried}
        return replace(
            self, d_surface=self.d_surface[rows], d_load=self.d_load[rows], carried=carried
        )

    def joined(self, other: Prediction) -> Prediction:
        """The prediction with the derivatives of another one at the same values behind its own."""
        n = len(self.d_load)
        return replace(
            self,
            d_surface=np.concatenate([self.d_surface, other.d_surface]),
            d_load=np.concatenate([self.d_load, other.d_load]),
            carried={**self.carried, **{n + row: c for row, c in other.carried.items()}},
        )

    @property
    def motion(self) -> FloatArray:
        """Motion at the pixels [µm], shape (T, n_pix, 3)."""
        return apply(self.look.value, self.surface)


@dataclass(frozen=True, eq=False)
class ForwardModel:
    """One specimen, one history, one solver.

    Attributes:
        material: constants of the case; parameters override them by name.
        microstructure: mesh and orientations with their parameters.
        boundary: motion of the end faces with its parameters.
        instrument: load cell and images, on the surface nodes.
        times: instants of the history [s], shape (n_times,).
        image_row: index of the instant of each image, shape (T,).
        surface_nodes: nodes of the measured face, shape (n,).
        adapter: the solver.
        integration: how the law is integrated over a time step.
        steps_per_interval: time steps between two instants.
        accuracy: error of the force that a time step may make [µN], or None for steps as given.
        view: where the pixels are on the face.
        workspace: where the solver keeps files of its runs, or None.
    """

    material: Material
    microstructure: Microstructure
    boundary: BoundaryMotion
    instrument: Instrument
    times: FloatArray
    image_row: IntArray
    surface_nodes: IntArray
    adapter: Adapter
    integration: Integration
    steps_per_interval: int
    accuracy: float | None
    view: SurfaceView
    workspace: Path | None = None

    def null_values(self) -> dict[str, float]:
        """Every parameter at its null, material constants as in the case, knots at zero."""
        declared = declared_parameters(self.boundary.weights.shape[1])
        values = {name: parameter.null for name, parameter in declared.items()}
        return values | {p.name: getattr(self.material, p.name) for p in MATERIAL_DECLARATIONS}

    def simulation(self, values: Values, free: Sequence[str] = ()) -> Simulation:
        """The hand-over to a solver, with a direction for each free parameter that it needs."""
        return Simulation(
            mesh=self.microstructure.moved_mesh(values),
            material=with_parameters(self.material, values),
            orientations=self.microstructure.rotated(values),
            times=self.times,
            motion_nodes=self.boundary.nodes,
            motion_mask=self.boundary.mask,
            motion=self.boundary.evaluate(values),
            output=self.image_row,
            output_nodes=self.surface_nodes,
            directions=tuple(self._direction(values, n) for n in free if self.simulated(n)),
            integration=self.integration,
            steps_per_interval=self.steps_per_interval,
            accuracy=self.accuracy,
        )

    def predict(
        self,
        values: Values,
        free: Sequence[str] = (),
        progress: Callable[[Progress], None] | None = None,
    ) -> Prediction:
        """Simulate and observe.

        Raises:
            SolverError: the simulation could not be finished.
            ValueError: a geometric parameter turns a cell inside out.
        """
        response = self.adapter.solve(self.simulation(values, free), self.workspace, progress)
        return self.observe(response, values, free)

    def observe(self, response: Response, values: Values, free: Sequence[str]) -> Prediction:
        """What the instruments make of a response."""
        T, n = response.displacement.shape[:2]
        d_surface, d_load = np.zeros((len(free), T, n, 3)), np.zeros((len(free), T))
        row = 0
        for index, name in enumerate(free):
            if self.simulated(name):
                d_surface[index] = response.d_displacement[row]
                d_surface[index, ..., 2] *= 1 + values["height_scale"]
                d_load[index] = (1 + values["load_gain"]) * response.d_force[row]
                row += 1
            elif name in _POSE_NAMES:
                continue
            elif name in _LOAD_NAMES:
                d_load[index] = self.instrument.reading_derivative(name, response.force)
            else:
                d_surface[index] = self.instrument.appearance_derivative(
                    name, response.displacement
                )
        surface = self.instrument.appearance(response.displacement, values)
        points = self.microstructure.moved_mesh(values).points[self.surface_nodes, :2]
        look = self.view.look(points, values)
        return Prediction(
            surface=surface,
            load=self.instrument.reading(response.force, values),
            d_surface=d_surface,
            d_load=d_load,
            carried=self._carried(surface, look, free),
            look=look,
            response=response,
        )

    def _carried(
        self, surface: FloatArray, look: Look, free: Sequence[str]
    ) -> dict[int, FloatArray]:
        """∂(motion at the pixels) from moving the pixels over the surface, or it under them."""
        carried: dict[int, FloatArray] = {}
        for index, name in enumerate(free):
            if name in _POSE_NAMES:
                slope = look.slope_X if name == "origin_X" else look.slope_Y
                carried[index] = apply(slope, surface)
            elif name in self.microstructure.velocities:
                flow = look.value @ self.microstructure.velocities[name][self.surface_nodes, :2]
                if np.any(flow):
                    along_X = apply(look.slope_X, surface) * flow[None, :, :1]
                    carried[index] = -along_X - apply(look.slope_Y, surface) * flow[None, :, 1:]
        return carried

    def simulated(self, name: str) -> bool:
        """Whether a parameter enters the simulation (and not only the observation)."""
        return name not in _LOAD_NAMES | _IMAGE_NAMES | _POSE_NAMES

    def _direction(self, values: Values, name: str) -> Direction:
        scale = declared_parameters(self.boundary.weights.shape[1])[name].change(values[name])
        if name in MATERIAL_PARAMETERS:
            return Direction(name, material={name: 1.0}, scale=scale)
        if name in self.microstructure.velocities:
            return Direction(name, points=self.microstructure.velocities[name], scale=scale)
        if name.startswith("rotation_"):
            rate = self.microstructure.rotation_rate(values, name)
            return Direction(name, rotation=rate, scale=scale)
        return Direction(name, motion=self.boundary.derivative(values, name), scale=scale)


_LOAD_NAMES = frozenset(p.name for p in LOAD_DECLARATIONS)
_IMAGE_NAMES = frozenset(p.name for p in IMAGE_DECLARATIONS)
_POSE_NAMES = frozenset(p.name for p in POSE_DECLARATIONS)

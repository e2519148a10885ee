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
from driver.load_clock import load_at
from driver.microstructure import (
    GEOMETRY_DECLARATIONS,
    LATTICE_DECLARATIONS,
    ORIENTATION_DECLARATIONS,
    Microstructure,
)
from driver.own_terms import installed_terms, refuse_doubles
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
    declarations_at,
    with_parameters,
)
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

Values = Mapping[str, float]

_OF_THE_PAPER = Material()


def declared_parameters(n_knots: int, material: Material = _OF_THE_PAPER) -> dict[str, Parameter]:
    """Every parameter of the general model by name, with its scale at a material."""
    declared = (
        *declarations_at(material),
        *BOUNDARY_DECLARATIONS,
        *knot_declarations(n_knots),
        *GEOMETRY_DECLARATIONS,
        *ORIENTATION_DECLARATIONS,
        *LATTICE_DECLARATIONS,
        *LOAD_DECLARATIONS,
        *IMAGE_DECLARATIONS,
        *POSE_DECLARATIONS,
        *(term.parameter for term in installed_terms()),
    )
    refuse_doubles(declared)
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

    @property
    def parameters(self) -> dict[str, Parameter]:
        """Every parameter by name, with its scale at the material of the case."""
        return declared_parameters(self.boundary.weights.shape[1], self.material)

    def null_values(self) -> dict[str, float]:
        """Every parameter at its null, material constants as in the case, knots at zero."""
        values = {name: parameter.null for name, parameter in self.parameters.items()}
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
            output=self._rows(values, free),
            output_nodes=self.surface_nodes,
            lattice_gradient=self.microstructure.lattice_gradient(values),
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
        """What the instruments make of the response to `simulation(values, free)`."""
        seen = np.searchsorted(self._rows(values, free), self.image_row)
        displacement = response.displacement[seen]
        force, rate, d_force = self._when_read(response, values, free)
        T, n = displacement.shape[:2]
        d_surface, d_load = np.zeros((len(free), T, n, 3)), np.zeros((len(free), T))
        row = 0
        for index, name in enumerate(free):
            if self.simulated(name):
                d_surface[index] = response.d_displacement[row, seen]
                d_surface[index, ..., 2] *= 1 + values["height_scale"]
                d_load[index] = self.instrument.reading_rate(force, d_force[row], values)
                row += 1
            elif name in _POSE_NAMES:
                continue
            elif name in self._load_names:
                d_load[index] = self.instrument.reading_derivative(name, force, rate, values)
            else:
                d_surface[index] = self.instrument.appearance_derivative(name, displacement)
        surface = self.instrument.appearance(displacement, values)
        points = self.microstructure.moved_mesh(values).points[self.surface_nodes, :2]
        look = self.view.look(points, values)
        return Prediction(
            surface=surface,
            load=self.instrument.reading(force, values),
            d_surface=d_surface,
            d_load=d_load,
            carried=self._carried(surface, look, free),
            look=look,
            response=response,
        )

    def _rows(self, values: Values, free: Sequence[str]) -> IntArray:
        """Rows of the history that are asked for: of the images, all where the load may lag."""
        return np.arange(self.times.size) if _lagging(values, free) else self.image_row

    def _when_read(
        self, response: Response, values: Values, free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force [µN], its rate [µN/s] and its derivatives when the load of each image is read."""
        if not _lagging(values, free):
            return response.force, np.zeros_like(response.force), response.d_force
        at = self.times[self.image_row] + values["load_lag"]
        force, rate = load_at(self.times, response.force, at)
        return force, rate, load_at(self.times, response.d_force, at)[0]

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
        return name not in self._load_names | _IMAGE_NAMES | _POSE_NAMES

    @property
    def _load_names(self) -> frozenset[str]:
        return _LOAD_NAMES | {term.parameter.name for term in self.instrument.terms}

    def _direction(self, values: Values, name: str) -> Direction:
        scale = self.parameters[name].change(values[name])
        if name in MATERIAL_PARAMETERS:
            return Direction(name, material={name: 1.0}, scale=scale)
        if name in self.microstructure.velocities:
            return Direction(name, points=self.microstructure.velocities[name], scale=scale)
        if name.startswith("rotation_"):
            rate = self.microstructure.rotation_rate(values, name)
            return Direction(name, rotation=rate, scale=scale)
        if name.startswith("lattice_gradient_"):
            gradient = self.microstructure.lattice_gradient_rate(name)
            return Direction(name, lattice_gradient=gradient, scale=scale)
        return Direction(name, motion=self.boundary.derivative(values, name), scale=scale)


def _lagging(values: Values, free: Sequence[str]) -> bool:
    """Whether the load may be read at another time than the image."""
    return values["load_lag"] != 0.0 or "load_lag" in free


_LOAD_NAMES = frozenset(p.name for p in LOAD_DECLARATIONS)
_IMAGE_NAMES = frozenset(p.name for p in IMAGE_DECLARATIONS)
_POSE_NAMES = frozenset(p.name for p in POSE_DECLARATIONS)

"""The forward model: parameters in, a prediction of what images and load cell show out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from driver.forward.boundary_motion import BoundaryMotion
from driver.forward.dwell_time import dwells, dwells_tangent, stretch_dwells
from driver.forward.instrument import Instrument
from driver.forward.load_lag import load_at
from driver.forward.mesh_extrapolation import MeshExtrapolation
from driver.forward.microstructure import Microstructure
from driver.forward.prediction import Prediction
from driver.forward.surface_projection import PixelProjection, Projection, apply
from driver.parameters.history import HOLD
from driver.parameters.registry import declared_parameters
from meshes.arrays import FloatArray, IntArray
from solver_adapters.interface import (
    Adapter,
    Direction,
    Integration,
    Progress,
    Response,
    Simulation,
    Trajectory,
)
from solver_adapters.material import Material, declarations_at, scalar, with_parameters
from solver_adapters.parameter import Parameter, Place

Values = Mapping[str, float]

_SHIFT = 0.01  # s, by which the rows of a reading are moved for a difference


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
        projection: where the pixels are on the face.
        tet10_points: Gauss points of a tetrahedron, None for those that the solver takes.
        mean_dilatation: whether the dilatation of a cell is projected on few functions.
        workspace: where the solver keeps files of its runs, or None.
        steps: ends of the time steps [s] on the clock of the history, as another response had
            them, or None for steps of its own.
        pattern: by how much the pattern of the flats would make the surface rise at the pixels
            were it left in the images [µm], shape (T, n_pix), or None where it is not known.
        trajectory: that of a nearby simulation on the clock of the history, by which simulations
            may begin their iterations, or None.
        extrapolation: the coarser model with which predictions are extrapolated, or None.
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
    projection: PixelProjection
    tet10_points: int | None = None
    mean_dilatation: bool = False
    workspace: Path | None = None
    steps: FloatArray | None = None
    pattern: FloatArray | None = None
    trajectory: Trajectory | None = None
    extrapolation: MeshExtrapolation | None = None

    @cached_property
    def parameters(self) -> dict[str, Parameter]:
        """Every parameter by name, with its scale at the material and orientations of the case."""
        n_knots = self.boundary.weights.shape[1]
        return declared_parameters(
            n_knots, self.material, self.microstructure.scales, self.n_grains
        )

    @property
    def n_grains(self) -> int:
        """Number of grains."""
        return len(self.microstructure.orientations)

    def null_values(self) -> dict[str, float]:
        """Every parameter at its null, material constants as in the case, knots at zero."""
        values = {name: parameter.null for name, parameter in self.parameters.items()}
        law = declarations_at(self.material, max(self.n_grains, 2))
        return values | {p.name: scalar(self.material, p.name) for p in law}

    def simulation(self, values: Values, free: Sequence[str] = ()) -> Simulation:
        """Return the hand-over to a solver, with a direction for each free parameter that it needs.

        Raises:
            SolverError: a geometric parameter turns a cell inside out.
        """
        times = self.clock(values)
        steps = None if self.steps is None else np.interp(self.steps, self.times, times)
        return Simulation(
            mesh=self.microstructure.moved_mesh(values),
            material=with_parameters(self.material, values),
            orientations=self.microstructure.rotated(values),
            times=times,
            motion_nodes=self.boundary.nodes,
            motion_mask=self.boundary.mask,
            motion=self.boundary.evaluate(values),
            output=self._rows(values, free),
            output_nodes=self.surface_nodes,
            lattice_gradient=self.microstructure.lattice_gradient(values),
            directions=tuple(self._direction(values, n) for n in free if self.simulated(n)),
            integration=self.integration,
            steps_per_interval=self.steps_per_interval,
            accuracy=self.accuracy if steps is None else None,
            steps=steps,
            tet10_points=self.tet10_points,
            mean_dilatation=self.mean_dilatation,
            warm_start=None
            if self.trajectory is None
            else _on_clock(self.trajectory, self.times, times),
        )

    def with_time_steps_of(self, ends: FloatArray, values: Values) -> ForwardModel:
        """Return the model that takes the time steps of a response of its own.

        Steps that refine themselves jump from one to the next parameters, and with them the
        error of the steps, and steps are cut where they do not converge, which hangs on where the
        iteration began; two simulations in the same steps differ by their parameters alone.

        Args:
            ends: where they end [s], `Response.ends`.
            values: the parameters that it was made with.
        """
        given = (self.times.size - 1) * self.steps_per_interval
        if not ends.size or (self.accuracy is None and ends.size == given):
            return self
        steps = np.interp(ends, self.clock(values), self.times)
        return self._with_coarser(lambda model: replace(model, steps=steps))

    def in_steps_of(self, other: ForwardModel) -> ForwardModel:
        """Return the model with the time steps that another one is asked for."""

        def stepped(model: ForwardModel) -> ForwardModel:
            steps, accuracy = other.steps_per_interval, other.accuracy
            return replace(model, steps_per_interval=steps, accuracy=accuracy)

        return self._with_coarser(stepped)

    def with_orientations(self, orientations: FloatArray) -> ForwardModel:
        """Return the model with other measured orientations, shape (n_grains, 3, 3)."""

        def turned(model: ForwardModel) -> ForwardModel:
            grains = replace(model.microstructure, orientations=orientations)
            return replace(model, microstructure=grains)

        return self._with_coarser(turned)

    def _with_coarser(self, changed: Callable[[ForwardModel], ForwardModel]) -> ForwardModel:
        """Return the model changed, and that with which it is extrapolated as well."""
        pair = self.extrapolation
        if pair is None:
            return changed(self)
        return replace(changed(self), extrapolation=replace(pair, coarser=changed(pair.coarser)))

    def cut_steps(self, response: Response) -> int:
        """Time steps of a response beyond those that are stated: steps that had to be cut."""
        stated = (self.times.size - 1) * self.steps_per_interval
        return max(response.ends.size - stated, 0) if self.accuracy is None else 0

    def warm_started_from(self, trajectory: Trajectory | None, values: Values) -> ForwardModel:
        """Return the model whose simulations begin their iterations by one of its own.

        Args:
            trajectory: the trajectory of that one, None of a solver that does not tell it.
            values: the parameters that it was made with.
        """
        if trajectory is None:
            return self
        return replace(self, trajectory=_on_clock(trajectory, self.clock(values), self.times))

    def predict(
        self,
        values: Values,
        free: Sequence[str] = (),
        progress: Callable[[Progress], None] | None = None,
    ) -> Prediction:
        """Simulate and observe.

        Raises:
            SolverError: the simulation could not be finished, or a geometric parameter turns a
                cell inside out.
        """
        simulation = self.simulation(values, free)
        response = self.adapter.solve(simulation, self.workspace, progress)
        prediction = self.observe(response, values, free)
        if self.extrapolation is None:
            return prediction
        coarser = self.extrapolation.coarser.predict(values, free, progress)
        both = self.extrapolation.applied(prediction, coarser)
        return replace(both, carried=self._carried(both.surface, both.projection, free))

    def clock(self, values: Values) -> FloatArray:
        """Return the instants of the history [s], shape (n_times,)."""
        return stretch_dwells(self.times, dwells(self.boundary.weights), values[HOLD])

    def _clock_rate(self, values: Values) -> FloatArray:
        """Return the derivative of the instants by the length of the holds, shape (n_times,)."""
        return dwells_tangent(self.times, dwells(self.boundary.weights), values[HOLD])

    def observe(self, response: Response, values: Values, free: Sequence[str]) -> Prediction:
        """Return what the instruments make of the response to `simulation(values, free)`."""
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
            elif self._enters(name, "pixels", "pattern"):
                continue
            elif self._enters(name, "load"):
                d_load[index] = self.instrument.reading_derivative(name, force, rate, values)
            else:
                d_surface[index] = self.instrument.appearance_derivative(name, displacement)
        surface = self.instrument.appearance(displacement, values)
        points = self.microstructure.moved_mesh(values).points[self.surface_nodes, :2]
        projection = self.projection.at(points, values)
        return Prediction(
            surface=surface,
            load=self.instrument.reading(force, values),
            d_surface=d_surface,
            d_load=d_load,
            carried=self._carried(surface, projection, free),
            projection=projection,
            response=response,
            rise=self._rise(values),
        )

    def with_pattern(
        self, prediction: Prediction, values: Values, free: Sequence[str]
    ) -> Prediction:
        """Return a prediction of this model that was made with another `pattern`."""
        carried = dict(prediction.carried)
        for index, name in enumerate(free):
            if self._enters(name, "pattern") and self.pattern is not None:
                carried[index] = _as_motion(self.pattern)
        return replace(prediction, rise=self._rise(values), carried=carried)

    def _rise(self, values: Values) -> FloatArray | float:
        return 0.0 if self.pattern is None else values["fixed_pattern"] * self.pattern

    def _rows(self, values: Values, free: Sequence[str]) -> IntArray:
        """Rows of the history that are asked for: of the images, all where the load may lag."""
        return np.arange(self.times.size) if _lagging(values, free) else self.image_row

    def _when_read(
        self, response: Response, values: Values, free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Force [µN], its rate [µN/s] and its derivatives when the load of each image is read."""
        if not _lagging(values, free):
            return response.force, np.zeros_like(response.force), response.d_force
        times = self.clock(values)
        at = times[self.image_row] + values["load_lag"]
        force, rate = load_at(times, response.force, at)
        d_force = load_at(times, response.d_force, at)[0]
        if HOLD in free:
            # The rows themselves come later, and with them the readings.
            moved = _SHIFT * self._clock_rate(values)
            later, earlier = (
                load_at(times + sense * moved, response.force, at + sense * moved[self.image_row])
                for sense in (1.0, -1.0)
            )
            row = [name for name in free if self.simulated(name)].index(HOLD)
            d_force[row] += (later[0] - earlier[0]) / (2.0 * _SHIFT)
        return force, rate, d_force

    def _carried(
        self, surface: FloatArray, projection: Projection, free: Sequence[str]
    ) -> dict[int, FloatArray]:
        """∂(motion at the pixels) from moving the pixels over the surface, or it under them."""
        carried: dict[int, FloatArray] = {}
        for index, name in enumerate(free):
            if self._enters(name, "pixels"):
                slope = projection.slope_X if name == "origin_X" else projection.slope_Y
                carried[index] = apply(slope, surface)
            elif self._enters(name, "pattern") and self.pattern is not None:
                carried[index] = _as_motion(self.pattern)
            elif self._enters(name, "nodes"):
                flow = (
                    projection.value @ self.microstructure.velocities[name][self.surface_nodes, :2]
                )
                if np.any(flow):
                    along_X = apply(projection.slope_X, surface) * flow[None, :, :1]
                    carried[index] = (
                        -along_X - apply(projection.slope_Y, surface) * flow[None, :, 1:]
                    )
        return carried

    def simulated(self, name: str) -> bool:
        """Whether a parameter enters the simulation (and not only the observation)."""
        return not self._enters(name, "load", "images", "pixels", "pattern")

    def _enters(self, name: str, *places: Place) -> bool:
        return self.parameters[name].enters in places

    def _direction(self, values: Values, name: str) -> Direction:
        scale = self.parameters[name].change(values[name])
        if self._enters(name, "clock"):
            return Direction(name, times=self._clock_rate(values), scale=scale)
        if self._enters(name, "law"):
            return Direction(name, material={name: 1.0}, scale=scale)
        if self._enters(name, "nodes"):
            return Direction(name, points=self.microstructure.velocities[name], scale=scale)
        if self._enters(name, "orientations"):
            rate = self.microstructure.rotation_rate(values, name)
            return Direction(name, rotation=rate, scale=scale)
        if self._enters(name, "lattice"):
            gradient = self.microstructure.lattice_gradient_rate(name)
            return Direction(name, lattice_gradient=gradient, scale=scale)
        return Direction(name, motion=self.boundary.derivative(values, name), scale=scale)


def _as_motion(rise: FloatArray) -> FloatArray:
    """Return a rise at the pixels as a motion, (T, n_pix) → (T, n_pix, 3)."""
    motion = np.zeros((*rise.shape, 3))
    motion[..., 2] = rise
    return motion


def _on_clock(trajectory: Trajectory, of_trajectory: FloatArray, wanted: FloatArray) -> Trajectory:
    """Return a trajectory on another clock: instants of one (n_times,) become those of another."""
    return replace(trajectory, times=np.interp(trajectory.times, of_trajectory, wanted))


def _lagging(values: Values, free: Sequence[str]) -> bool:
    """Whether the load may be read at another time than the image."""
    return values["load_lag"] != 0.0 or "load_lag" in free

"""The correction: finer minus working prediction, and how that changes with the parameters.

It is added to every working prediction (defect correction). What the mesh leaves wrong hangs on
where crystals yield, and so on the parameters: with the derivatives of both predictions the
corrected one follows the finer simulation to first order, and a fit ends where that would end.
Between two places, far from each other along one parameter, it goes straight.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from driver.common.parallel import side_by_side
from driver.forward.mesh_extrapolation import LackingShare, lacking_share
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.identification.data import Data
from driver.identification.step_error import (
    StepError,
    error_by_parts,
    has_first_order,
    in_parts_of,
    parts_of,
)
from meshes.arrays import FloatArray
from solver_adapters.interface import Trajectory
from solver_adapters.parameter import Parameter

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of a correction for θ, about where it was taken.

    Attributes:
        values: every parameter there.
        parameters: the k parameters for which they are known, in the order of the predictions.
        working, finer: the predictions there, their derivatives times what their difference is
            extrapolated by.
    """

    values: Mapping[str, float]
    parameters: tuple[Parameter, ...]
    working: Prediction
    finer: Prediction

    def change(self, values: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
        """Return by how much the correction is another one at other parameters.

        Args:
            values: every parameter.

        Returns:
            Motion at the pixels [µm], shape (T, n_pix, 3), and load [µN], shape (T,).
        """
        moved = [
            p.theta(values[p.name], self.values[p.name]) * p.slope(self.values[p.name])
            for p in self.parameters
        ]
        (motion, load), (less_motion, less_load) = (
            prediction.along(np.array(moved)) for prediction in (self.finer, self.working)
        )
        return motion - less_motion, load - less_load

    def completed_by(self, other: Derivatives) -> Derivatives:
        """Return these with those for parameters that they lack, about where these were taken."""
        more = [k for k, p in enumerate(other.parameters) if p not in self.parameters]
        return replace(
            self,
            parameters=(*self.parameters, *(other.parameters[k] for k in more)),
            working=self.working.joined(other.working.restrict(more)),
            finer=self.finer.joined(other.finer.restrict(more)),
        )

    def sensitivity(self, data: Data, free: Sequence[str]) -> FloatArray:
        """Whitened derivatives for the θ of some parameters, shape (k, n), 0 for those unknown."""
        names = [p.name for p in self.parameters]
        known = [(row, names.index(name)) for row, name in enumerate(free) if name in names]
        rows, columns = [row for row, _ in known], [column for _, column in known]
        slopes = np.array([p.slope(self.values[p.name]) for p in self.parameters])[columns]
        finer, working = (data.sensitivity(p.restrict(columns)) for p in (self.finer, self.working))
        whole = np.zeros((len(free), finer.shape[1]))
        whole[rows] = slopes[:, None] * (finer - working)
        return whole


@dataclass(frozen=True, eq=False)
class Secant:
    """What a correction changes by along one parameter, linear in θ, beside what derivatives tell.

    Attributes:
        parameter: it.
        begin, end: its values where the change is nothing, and where it is known.
        motion, load: the change there [µm], shape (T, n_pix, 3), and [µN], shape (T,).
    """

    parameter: Parameter
    begin: float
    end: float
    motion: FloatArray
    load: FloatArray

    @property
    def slope(self) -> float:
        """Part of the change for a unit of θ."""
        return 1.0 / self.parameter.theta(self.end, self.begin)

    def share(self, values: Mapping[str, float]) -> float:
        """Return the part of the change at other parameters."""
        return self.parameter.theta(values[self.parameter.name], self.begin) * self.slope


@dataclass(frozen=True, eq=False)
class Correction:
    """Finer minus working prediction, extrapolated, which is added to every working prediction.

    Attributes:
        motion: at the pixels [µm], shape (T, n_pix, 3), or 0.
        load: [µN], shape (T,), or 0.
        left_by_steps: what time steps leave wrong, None where the scheme is not of first order.
        parts: q, equal parts of each working step of first order that are stated: of an error e of
            the working steps the correction holds e (1 − 1/q) and leaves e/q.
        derivatives: of motion and load, None where they are not known.
        secant: what it changes by along one parameter beside that, None where that is not known.
        course: trajectory of the finer simulation on the clock of the history, by which a later
            one begins its iterations; None where there is none.
    """

    motion: FloatArray | float = 0.0
    load: FloatArray | float = 0.0
    left_by_steps: StepError | None = None
    parts: int = 1
    derivatives: Derivatives | None = None
    secant: Secant | None = None
    course: Trajectory | None = None

    @property
    def is_constant(self) -> bool:
        """Whether nothing is known of how it changes with the parameters."""
        return self.derivatives is None and self.secant is None

    def at(self, values: Mapping[str, float]) -> Correction:
        """Return the correction as it is at other parameters, as far as is known, and constant."""
        if self.is_constant:
            return self
        here = replace(self, derivatives=None, secant=None)
        if self.derivatives is not None:
            here = here.plus(*self.derivatives.change(values))
        if self.secant is not None:
            share = self.secant.share(values)
            here = here.plus(share * self.secant.motion, share * self.secant.load)
        return here

    def sensitivity(self, data: Data, free: Sequence[str]) -> FloatArray | None:
        """Whitened derivatives for the θ of some parameters, shape (k, n); None where constant."""
        whole, secant = None, self.secant
        if self.derivatives is not None:
            whole = self.derivatives.sensitivity(data, free)
        if secant is not None and secant.parameter.name in free:
            along = secant.slope * data.change(secant.motion, secant.load)
            whole = np.zeros((len(free), along.size)) if whole is None else whole
            whole[tuple(free).index(secant.parameter.name)] += along
        return whole

    def through(
        self, other: Correction, values: Mapping[str, float], begin: float, parameter: Parameter
    ) -> Correction:
        """Return the correction that goes straight to another one along one parameter.

        Its derivatives for all others stay, and what time steps leave. A finer simulation begins
        its iterations by the course of the other one.

        Args:
            other: one without derivatives.
            values: every parameter where it was taken.
            begin: another value of the parameter than there, at which this one holds.
            parameter: it.
        """
        known = self.at(values)
        motion = np.asarray(other.motion) - np.asarray(known.motion)
        load = np.asarray(other.load) - np.asarray(known.load)
        secant = Secant(parameter, begin, values[parameter.name], motion, load)
        return replace(self, secant=secant, course=other.course)

    def completed_by(self, other: Correction) -> Correction:
        """Return this correction with the derivatives that it lacks of another one, if it has any.

        Args:
            other: taken nearby; a constant one where its derivatives do not hold here.
        """
        mine, known = self.derivatives, other.derivatives
        if mine is None or known is None:
            return self
        return replace(self, derivatives=mine.completed_by(known))

    @property
    def of_mesh(self) -> tuple[FloatArray, FloatArray]:
        """Motion [µm], (T, n_pix, 3), and load [µN], (T,), as far as they are of the mesh."""
        motion, load = np.asarray(self.motion), np.asarray(self.load)
        if self.left_by_steps is None:
            return motion, load
        held = self.left_by_steps.times(self.parts - 1)
        return motion - held.motion, load - held.load

    def plus(self, motion: FloatArray, load: FloatArray) -> Correction:
        """Return the correction with more of both [µm, µN]."""
        return replace(self, motion=self.motion + motion, load=self.load + load)

    def with_second(self, second: SecondMesh | None) -> Correction:
        """Return what this correction by a finer mesh and a second one say together.

        Args:
            second: the second one, None where there is none.
        """
        if second is None:
            return self
        return self.plus(np.asarray(second.added.motion), np.asarray(second.added.load))

    def without_second(self, second: SecondMesh | None) -> Correction:
        """Return what the finer mesh says alone, of a correction `with_second`."""
        if second is None:
            return self
        return self.plus(-np.asarray(second.added.motion), -np.asarray(second.added.load))


@dataclass(frozen=True, eq=False)
class SecondMesh:
    """What a second finer mesh says beside a first one.

    Attributes:
        difference: its correction less that by the first one [µm, µN].
        size: of its cells, where they are the better ones and take the place of the first [µm];
            None where both meshes are as good as each other, and their mean is better than either.
    """

    difference: Correction
    size: float | None = None

    @property
    def is_better(self) -> bool:
        """Whether it takes the place of the first."""
        return self.size is not None

    @property
    def added(self) -> Correction:
        """What is added to the correction by the first one: all of the difference, or half."""
        return self.difference if self.is_better else self._half

    @property
    def off(self) -> Correction | None:
        """What the mean is off by, one standard deviation; None where the second one judges."""
        return None if self.is_better else self._half

    @property
    def _half(self) -> Correction:
        motion, load = np.asarray(self.difference.motion), np.asarray(self.difference.load)
        return Correction(0.5 * motion, 0.5 * load)


def correction(
    working: ForwardModel,
    finer: ForwardModel,
    coarse: Prediction,
    values: Mapping[str, float],
    free: Sequence[str] = (),
    near: Correction | None = None,
    left_by_steps: StepError | None = None,
) -> Correction:
    """Finer minus working prediction, extrapolated where both meshes are of one family.

    The finer mesh takes the steps that are stated for the working one, of first order those that
    were taken; where it has to cut more of these, the working mesh is simulated in its steps, too.
    What finer steps change is told by the working mesh, as constant: the product of both errors is
    left out.

    Args:
        working: the working model.
        finer: the finer model.
        coarse: the working prediction.
        values: every parameter that it was made with.
        free: the parameters for which the working prediction has derivatives, in that order. The
            correction gets them where they cost no further simulations.
        near: a correction by the same finer mesh at other parameters, by whose course the finer
            simulation begins its iterations.
        left_by_steps: what the correction will leave of time steps of first order, where that is
            known of as many parts of each; it is simulated where it is not.

    Raises:
        SolverError: a simulation could not be finished.
    """
    first_order = has_first_order(working, coarse)
    parts = parts_of(working, finer) if first_order else 1
    exact = finer.adapter.capabilities().runs_per_direction == 0
    asked = tuple(free) if exact else ()
    meshes = [model.microstructure.mesh for model in (working, finer)]
    more = lacking_share(*meshes) if finer.extrapolation is None else LackingShare()
    if near is not None and near.course is not None:
        finer = replace(finer, trajectory=near.course)
    of_steps: list[ForwardModel] = []
    divided = max(parts, 2)  # halves tell an error of which nothing is held, too
    if first_order and left_by_steps is None:
        of_steps = [in_parts_of(working, coarse, values, divided)]
    elif not first_order and finer.steps_per_interval > working.steps_per_interval:
        of_steps = [working.in_steps_of(finer)]
    finer = finer.in_steps_of(working)
    if first_order:
        finer = finer.with_time_steps_of(coarse.response.ends, values)
    runs = [(finer, asked), *((model, ()) for model in of_steps)]
    # One after the other; jobs for another machine are prepared all at once.
    fine, *stepped = side_by_side(lambda run: run[0].predict(values, run[1]), runs, 1)
    alike, ends = coarse, fine.response.ends
    if first_order and ends.size > coarse.response.ends.size:
        more_cuts = ends.size - coarse.response.ends.size
        logger.info(f"  {more_cuts} more steps were cut on the finer mesh: the working one in them")
        alike = working.with_time_steps_of(ends, values).predict(values, asked)
    motion, load = fine.motion - alike.motion, fine.load - alike.load
    of_motion = f", motion {1e3 * np.sqrt(np.mean(motion**2)):.2f} nm rms" if motion.size else ""
    logger.info(f"  finer − working: load {np.sqrt(np.mean(load**2)):.2f} µN rms{of_motion}")
    if more:
        logger.info(
            "  extrapolated to cells of no size: "
            f"{1 + more.motion:.2f} times in the motion, {1 + more.load:.2f} times in the load"
        )
    course = finer.warm_started_from(fine.response.trajectory, values).trajectory
    derivatives = None
    if asked:
        declared = tuple(working.parameters[name] for name in asked)
        both = [
            prediction.derivatives_alone().with_derivatives_times(1 + more.motion, 1 + more.load)
            for prediction in (alike, fine)
        ]
        derivatives = Derivatives(dict(values), declared, *both)
    motion, load = (1 + more.motion) * motion, (1 + more.load) * load
    found = Correction(motion, load, None, parts, derivatives, course=course)
    if not first_order:
        for one in stepped:
            found = found.plus(one.motion - coarse.motion, one.load - coarse.load)
        return found
    left = left_by_steps
    if left is None:
        left = error_by_parts(coarse, stepped[0], divided).times(1 / parts)
    held = left.times(parts - 1)
    cuts = working.cut_steps(coarse.response)
    cut = f"{cuts} more than stated, as some were cut; " if cuts else ""
    corrected, wrong = (np.sqrt(np.mean(error.load**2)) for error in (held, left))
    logger.info(
        f"  time steps of first order: {cut}{corrected:.2f} µN rms of the load are corrected, "
        f"{wrong:.2f} are still wrong, which the uncertainties count"
    )
    return replace(found.plus(held.motion, held.load), left_by_steps=left)

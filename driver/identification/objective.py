"""What is minimised: the whitened residual of a model with a Gaussian prior, and its derivatives.

The variable of each parameter is θ (`Parameter.theta`): a logarithm or a scaled difference.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from driver.forward.fixed_pattern import apparent_rise
from driver.forward.model import ForwardModel
from driver.forward.prediction import Prediction
from driver.identification.correction import Correction, SecondMesh
from driver.identification.data import Data
from driver.identification.paper_chi import PaperChi, paper_chi
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter


@dataclass(frozen=True, eq=False)
class Objective:
    """What is minimised.

    Attributes:
        model: the forward model.
        data: the measurements.
        parameters: declarations by name.
        prior: mean (value) and standard deviation (in θ) of the parameters that have a prior.
        correction: finer minus working prediction, as two finer meshes have it together where a
            second one was needed.
        second: the second of them, None where there is one.
    """

    model: ForwardModel
    data: Data
    parameters: Mapping[str, Parameter]
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correction: Correction = Correction()
    second: SecondMesh | None = None

    def sizes_behind(self, first: tuple[float, float]) -> tuple[float, float]:
        """Return the element sizes by which it is known what the correction leaves wrong [µm].

        Args:
            first: of the working mesh and of the first finer one [µm].
        """
        if self.second is None or self.second.size is None:
            return first
        return first[0], self.second.size

    def evaluate(self, values: Mapping[str, float], free: Sequence[str]) -> Evaluation:
        """Simulate and compare.

        Raises:
            SolverError: as `ForwardModel.predict`.
        """
        prediction = self.model.predict(values, free)
        return self.compare(prediction, values, free)

    def with_pattern_at(self, here: Evaluation) -> tuple[Objective, Evaluation]:
        """Return the objective that reads the fixed pattern where an evaluation sees the specimen.

        Free correlation knows less well where that is, and errs with the noise of the images.

        Returns:
            The objective, and what the evaluation is under it.
        """
        image = self.data.image
        if image.images.flat_pattern is None:
            return self, here
        moved = here.motion.copy()
        moved[self.data.index] += np.einsum("tr,rpc->tpc", here.shift, image.rigid)
        rise = apparent_rise(image.images, moved)
        there = replace(self, model=replace(self.model, pattern=rise))
        prediction = there.model.with_pattern(here.prediction, here.values, here.free)
        return there, there.compare(prediction, here.values, here.free)

    def with_time_steps_of(self, here: Evaluation) -> Objective:
        """Return the objective whose simulations take the time steps of an evaluation."""
        model = self.model.with_time_steps_of(here.prediction.response.ends, here.values)
        return replace(self, model=model)

    def warm_started_from(self, here: Evaluation) -> Objective:
        """Return objective whose simulations begin their iterations by that of an evaluation."""
        return replace(
            self,
            model=self.model.warm_started_from(here.prediction.response.trajectory, here.values),
        )

    def compare(
        self, prediction: Prediction, values: Mapping[str, float], free: Sequence[str]
    ) -> Evaluation:
        """Residual and Jacobian of a prediction."""
        correction = self.correction.at(values)
        motion = prediction.motion + correction.motion
        load = prediction.load + correction.load
        residual, shift, rho = self.data.residual(motion, load)
        return replace(
            self.expect(prediction, values, free),
            residual=residual,
            load=load,
            motion=motion,
            shift=shift,
            rho=rho,
            paper=paper_chi(self.data, load, rho),
        )

    def cost_about(
        self, here: Evaluation, prediction: Prediction, values: Mapping[str, float]
    ) -> float:
        """Return ‖r‖² + prior of a prediction, images taken to first order about an evaluation.

        What interpolation makes of the noise of the images between two places is left out: it
        would be taken for an effect of the parameters.

        Args:
            here: the evaluation, under this objective.
            prediction: at other values of its free parameters.
            values: every parameter there.
        """
        correction = self.correction.at(values)
        motion = prediction.motion + correction.motion - here.motion
        load = prediction.load + correction.load - here.load
        residual = here.residual - self.data.change(motion, load)
        gap, weight = self._prior_at(values, here.free)
        return float(residual @ residual + weight @ gap**2)

    def expect(
        self, prediction: Prediction, values: Mapping[str, float], free: Sequence[str]
    ) -> Evaluation:
        """Return what a prediction would say of parameters to data that it meets exactly.

        No image is looked at: there need not be any.
        """
        slopes = np.array([self.parameters[name].slope(values[name]) for name in free])
        jacobian = self.data.sensitivity(prediction)
        jacobian *= slopes[:, None]
        more = self.correction.sensitivity(self.data, free)
        if more is not None:
            jacobian += more
        gap, weight = self._prior_at(values, free)
        image, n_frames = self.data.image, self.data.index.size
        return Evaluation(
            values=dict(values),
            free=tuple(free),
            residual=np.zeros(jacobian.shape[1]),
            jacobian=jacobian,
            prior_gap=gap,
            prior_weight=weight,
            n_load=self.data.n_load,
            load=prediction.load,
            motion=prediction.motion,
            shift=np.zeros((n_frames, len(image.rigid))),
            rho=np.zeros((n_frames, len(image.images.xy))),
            prediction=prediction,
            paper=PaperChi(0.0, 0.0, 0.0),
        )

    def with_free(self, evaluation: Evaluation, free: Sequence[str]) -> Evaluation:
        """Return an evaluation at the same values with other parameters free.

        Only the derivatives that it lacks are simulated; data, prior and correction may be others.

        Raises:
            SolverError: as `ForwardModel.predict`.
        """
        missing = tuple(name for name in free if name not in evaluation.free)
        prediction, names = evaluation.prediction, evaluation.free + missing
        if missing:
            same = self.with_time_steps_of(evaluation).warm_started_from(evaluation).model
            prediction = prediction.joined(same.predict(evaluation.values, missing))
        rows = [names.index(name) for name in free]
        return self.compare(prediction.restrict(rows), evaluation.values, free)

    def restrict(self, evaluation: Evaluation, free: Sequence[str]) -> Evaluation:
        """Return an evaluation as if only some of its parameters were free, with this prior."""
        rows = [evaluation.free.index(name) for name in free]
        gap, weight = self._prior_at(evaluation.values, free)
        return replace(
            evaluation,
            free=tuple(free),
            jacobian=evaluation.jacobian[rows],
            prior_gap=gap,
            prior_weight=weight,
            prediction=evaluation.prediction.restrict(rows),
        )

    def _prior_at(
        self, values: Mapping[str, float], free: Sequence[str]
    ) -> tuple[FloatArray, FloatArray]:
        gap, weight = np.zeros(len(free)), np.zeros(len(free))
        for i, name in enumerate(free):
            if name in self.prior:
                mean, width = self.prior[name]
                gap[i] = self.parameters[name].theta(mean, values[name])
                weight[i] = width**-2
        return gap, weight


@dataclass(frozen=True, eq=False)
class Evaluation:
    """A prediction held against the data, k free parameters, n whitened numbers.

    Attributes:
        values: every parameter.
        free: names of the free ones.
        residual: whitened, loads first, shape (n,).
        jacobian: derivative of the whitened prediction with respect to θ, shape (k, n).
        prior_gap: prior mean minus value in θ, shape (k,).
        prior_weight: prior precision in θ, shape (k,).
        n_load: numbers of the load part.
        load: predicted readings [µN], corrected, shape (T_all,).
        motion: predicted motion at the pixels [µm], corrected, shape (T_all, n_pix, 3).
        shift: rigid motion that each frame in use needed [µm], shape (T, n_rigid).
        rho: image residual of the frames in use [µm], shape (T, n_pix).
        prediction: the prediction itself.
        paper: χ, χ_f and χ_F in the weighting of the paper.
    """

    values: dict[str, float]
    free: tuple[str, ...]
    residual: FloatArray
    jacobian: FloatArray
    prior_gap: FloatArray
    prior_weight: FloatArray
    n_load: int
    load: FloatArray
    motion: FloatArray
    shift: FloatArray
    rho: FloatArray
    prediction: Prediction
    paper: PaperChi

    @property
    def misfit(self) -> float:
        """‖r‖², the prior left out."""
        return float(self.residual @ self.residual)

    @property
    def excess(self) -> float:
        """‖r‖² above its expectation from noise alone, at least 0."""
        return max(self.misfit - (self.residual.size - len(self.free)), 0.0)

    @property
    def cost(self) -> float:
        """‖r‖² with the prior."""
        return self.misfit + float(self.prior_weight @ self.prior_gap**2)

    @property
    def chi_load(self) -> float:
        """χ_F: root mean square of the whitened load residual."""
        return float(np.sqrt(np.mean(self.residual[: self.n_load] ** 2))) if self.n_load else 0.0

    @property
    def chi_image(self) -> float:
        """Root mean square of the whitened image residual on the correlation basis."""
        part = self.residual[self.n_load :]
        return float(np.sqrt(np.mean(part**2))) if part.size else 0.0

    @property
    def hessian(self) -> FloatArray:
        """JJᵀ + prior, shape (k, k)."""
        return np.asarray(self.jacobian @ self.jacobian.T + np.diag(self.prior_weight))

    @property
    def gradient(self) -> FloatArray:
        """Downhill direction J r + prior, shape (k,)."""
        return np.asarray(self.jacobian @ self.residual + self.prior_weight * self.prior_gap)

"""Gauss–Newton on the whitened residual with a Gaussian prior (Hessian JJᵀ + P, J of shape (k, n)).

The variable of each parameter is θ (`Parameter.theta`): a logarithm or a scaled difference.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from time import monotonic

import numpy as np
from numpy.typing import NDArray

from driver.identification.data import Data
from driver.identification.paper_chi import PaperChi, paper_chi
from driver.identification.step import bounded_step, is_at_bound, trial_values
from driver.model import ForwardModel, Prediction
from solver_adapters.interface import NotRunError, SolverError
from solver_adapters.jobs.errors import JobError, is_by_circumstances
from solver_adapters.jobs.status import Status
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]

DECREMENT = 0.1  # Newton decrement at convergence: a tenth of a standard deviation
# A model error leaves an excess misfit, and makes convergence slow (its residual is large where
# the model is curved). A step that would lower the excess by a hundredth changes no answer. What
# noise alone scatters by is no excess.
NEGLIGIBLE = math.sqrt(1e-2)
SCATTER = 3.0  # standard deviations of ‖r‖²
MOST_HALVINGS = 5
# Step control and iteration of a solver scatter the cost by hundredths. A step that promises less
# than a tenth and does not lower it, nor do two shorter ones, has met that scatter.
FLAT = 0.3
NEAR = 10.0
"""Newton decrement [σ] below which the trial points take the time steps of the last one: the cost
is then smooth, where steps of their own would make it jump by about as much as is to be gained."""
Log = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class Correction:
    """Finer minus working prediction, added to every working prediction (defect correction).

    Attributes:
        motion: at the pixels [µm], shape (T, n_pix, 3), or 0.
        load: [µN], shape (T,), or 0.
    """

    motion: FloatArray | float = 0.0
    load: FloatArray | float = 0.0


@dataclass(frozen=True, eq=False)
class Objective:
    """What is minimised.

    Attributes:
        model: the forward model.
        data: the measurements.
        parameters: declarations by name.
        prior: mean (value) and standard deviation (in θ) of the parameters that have a prior.
        correction: finer minus working prediction.
    """

    model: ForwardModel
    data: Data
    parameters: Mapping[str, Parameter]
    prior: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    correction: Correction = Correction()

    def evaluate(self, values: Mapping[str, float], free: Sequence[str]) -> Evaluation:
        """Simulate and compare.

        Raises:
            SolverError, ValueError: as `ForwardModel.predict`.
        """
        prediction = self.model.predict(values, free)
        return self.compare(prediction, values, free)

    def in_steps_of(self, here: Evaluation) -> Objective:
        """The objective whose simulations take the time steps of an evaluation."""
        model = self.model.in_steps_of(here.prediction.response, here.values)
        return replace(self, model=model)

    def compare(
        self, prediction: Prediction, values: Mapping[str, float], free: Sequence[str]
    ) -> Evaluation:
        """Residual and Jacobian of a prediction."""
        motion = prediction.motion + self.correction.motion
        load = prediction.load + self.correction.load
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

    def expect(
        self, prediction: Prediction, values: Mapping[str, float], free: Sequence[str]
    ) -> Evaluation:
        """What a prediction, held against data that it meets exactly, would say of parameters.

        No image is looked at: there need not be any.
        """
        slopes = np.array([self.parameters[name].slope(values[name]) for name in free])
        jacobian = self.data.sensitivity(prediction)
        jacobian *= slopes[:, None]
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

    def complete(self, evaluation: Evaluation, free: Sequence[str]) -> Evaluation:
        """An evaluation at the same values with other parameters free.

        Only the derivatives that it lacks are simulated; data, prior and correction may be others.

        Raises:
            SolverError, ValueError: as `ForwardModel.predict`.
        """
        missing = tuple(name for name in free if name not in evaluation.free)
        prediction, names = evaluation.prediction, evaluation.free + missing
        if missing:
            prediction = prediction.joined(self.model.predict(evaluation.values, missing))
        rows = [names.index(name) for name in free]
        return self.compare(prediction.restrict(rows), evaluation.values, free)

    def restrict(self, evaluation: Evaluation, free: Sequence[str]) -> Evaluation:
        """An evaluation as if only some of its parameters were free, with this prior."""
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


@dataclass(frozen=True, eq=False)
class Fit:
    """The end of a fit.

    Attributes:
        best: the evaluation at the optimum.
        converged: whether the Newton decrement became negligible.
        reason: why the iteration ended.
        history: values of the free parameters, cost and χ after each iteration.
        start_load: predicted readings where the fit began [µN], shape (T_all,); empty if it was
            not iterated.
        seconds: duration, wall clock.
    """

    best: Evaluation
    converged: bool
    reason: str
    history: tuple[dict[str, float], ...]
    start_load: FloatArray = field(default_factory=lambda: np.empty(0))
    seconds: float = 0.0

    @property
    def values(self) -> dict[str, float]:
        """Every parameter at the optimum."""
        return self.best.values

    def at_bounds(self, parameters: Mapping[str, Parameter]) -> tuple[str, ...]:
        """Names of the free parameters that stand at a bound."""
        return tuple(n for n in self.best.free if is_at_bound(parameters[n], self.values[n]))

    @property
    def covariance(self) -> FloatArray:
        """Covariance H⁻¹ of θ, shape (k, k)."""
        return np.asarray(np.linalg.inv(self.best.hessian), dtype=np.float64)

    def sigma(self, name: str, parameters: Mapping[str, Parameter]) -> float:
        """Standard deviation of a value (to first order)."""
        index = self.best.free.index(name)
        slope = parameters[name].slope(self.values[name])
        return float(np.sqrt(self.covariance[index, index]) * slope)


def fit(
    objective: Objective,
    values: Mapping[str, float],
    free: Sequence[str],
    most: int,
    log: Log,
    start: Evaluation | None = None,
    tolerance: float = DECREMENT,
    share: float = 0.0,
) -> Fit:
    """Minimise the cost; a step that fails, runs out of time or climbs is shortened.

    Args:
        objective: model and data.
        values: every parameter at the start.
        free: names of the parameters to identify.
        most: largest number of iterations.
        log: takes one line for each iteration, and for each trial point that fails.
        start: evaluation at `values` with `free`, where it is known already.
        tolerance: Newton decrement at which the fit has converged [σ].
        share: the fit also ends when a step lowers the cost, or would, by less than this share
            of it: enough for a fit that only starts another one.

    Raises:
        SolverError, ValueError: the model cannot be evaluated at the start.
        NotRunError: a simulation was not run: the solver is absent, or its job was prepared.
        JobError, ResultFileError: a simulation was killed, ran out of memory or left no result.
    """
    began = monotonic()
    here = start if start is not None else objective.evaluate(values, free)
    start_load, history = here.load, [_record(here)]

    def ended(converged: bool, reason: str) -> Fit:
        log(f"  {'ended' if converged else 'NOT converged'}: {reason}")
        return Fit(here, converged, reason, tuple(history), start_load, monotonic() - began)

    _tell(log, 0, here, None)
    iteration = 0
    while True:
        step, decrement = bounded_step(
            here.hessian, here.gradient, [objective.parameters[n] for n in here.free],
            [here.values[n] for n in here.free],
        )  # fmt: skip
        excess = max(here.excess - SCATTER * math.sqrt(2.0 * here.residual.size), 0.0)
        enough = max(tolerance, math.sqrt(share * here.cost), math.sqrt(excess) * NEGLIGIBLE)
        if decrement < enough:
            return ended(True, f"the Newton decrement is {decrement:.2g} σ")
        if iteration == most:
            reason = f"the limit of {most} iterations, decrement {decrement:.2g} σ"
            return ended(False, reason)
        flat = decrement < FLAT
        tried = objective.in_steps_of(here) if decrement < NEAR else objective
        ahead = _descend(tried, here, step, log, 3 if flat else MOST_HALVINGS)
        if ahead is None and flat:
            return ended(True, f"a step of {decrement:.2g} σ does not lower the cost")
        if ahead is None:
            reason = f"no shorter step lowers the cost (decrement {decrement:.2g} σ)"
            return ended(False, reason)
        gained = here.cost - ahead.cost
        fallen = gained / here.cost
        here, iteration = ahead, iteration + 1
        history.append(_record(here))
        _tell(log, iteration, here, decrement)
        if fallen < share:
            reason = f"the last step lowered the cost by {fallen:.1%}"
            return ended(True, reason)
        if gained < tolerance**2:
            # Derivatives by differences may promise a gain for ever that never comes.
            return ended(True, f"the last step lowered the cost by {gained:.1g} only")


def _descend(
    objective: Objective, here: Evaluation, step: FloatArray, log: Log, trials: int
) -> Evaluation | None:
    length = 1.0
    for _ in range(trials):
        values = trial_values(here.values, here.free, length * step, objective.parameters)
        try:
            ahead = objective.evaluate(values, here.free)
        except NotRunError:
            raise  # a shorter step would not be run either
        except (SolverError, ValueError) as error:
            if is_by_circumstances(error) and not _ran_out_of_time(error):
                raise  # a shorter step might be killed as well, and would prove nothing
            first = str(error).partition("\n")[0].removesuffix("; its log ends:")
            log(f"    a trial point failed, so that the step is shortened: {first}")
            ahead = None
        if ahead is not None and ahead.cost < here.cost:
            return ahead
        length *= 0.4
    return None


def _ran_out_of_time(error: Exception) -> bool:
    return isinstance(error, JobError) and error.status is Status.OUT_OF_TIME


def _record(here: Evaluation) -> dict[str, float]:
    record = {name: here.values[name] for name in here.free}
    return record | {
        "cost": here.cost, "chi_load": here.chi_load, "chi_image": here.chi_image,
        "paper_chi": here.paper.chi, "paper_chi_f": here.paper.chi_f,
        "paper_chi_F": here.paper.chi_F,
    }  # fmt: skip


def _tell(log: Log, iteration: int, here: Evaluation, decrement: float | None) -> None:
    loads = f"χ_F {here.chi_load:7.2f}  " if here.n_load else ""
    images = f"χ of images {here.chi_image:.3f}" if here.residual.size > here.n_load else ""
    step = "" if decrement is None else f"  step {decrement:.3g} σ"
    log(f"  iteration {iteration}: {loads}{images}{step}")
    for note in here.prediction.response.notes:
        log(f"    {note}")

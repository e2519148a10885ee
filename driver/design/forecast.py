"""What an experiment will say: its simulation, linearised, weighed as the identification does."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from driver.common.progress import quiet
from driver.design.detectability import outlooks
from driver.design.information import LOOSE, knowledge
from driver.design.schedule import carried_on, changed, compressed
from driver.design.settings import Settings
from driver.design.surface import Surface, expected_surface
from driver.design.variants import Variant
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.causes.user_causes import user_causes
from driver.diagnosis.statistics.screening import screened
from driver.experiment.history import History, knot_weights
from driver.forward.build import mesh_of
from driver.forward.prediction import Prediction
from driver.identification.correction import Correction, correction
from driver.identification.identify import with_correction
from driver.identification.objective import Objective
from driver.identification.problem import IdentificationProblem, MeasuredSeries, build_problem
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.parameters.registry import declared_parameters
from driver.results.design import Knowledge, Outlook
from driver.virtual.truth import knots, refuse_unknown
from meshes.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Plan:
    """All that a forecast needs.

    Attributes:
        variant: the experiment.
        history: times, stage travel and images of the case, unchanged.
        surface: what the images of the case will show.
        settings: what is assumed.
        jobs: folder of the jobs of a solver that is a program of its own, or None.
    """

    variant: Variant
    history: History
    surface: Surface
    settings: Settings
    jobs: Path | None


@dataclass(frozen=True, eq=False)
class Simulated:
    """A simulation that serves all variants which differ in noise and weights alone.

    Attributes:
        prediction: with the derivatives of the fitted parameters and those of the causes.
        names: of these parameters, in the order of the derivatives.
        change: finer minus working prediction.
    """

    prediction: Prediction
    names: tuple[str, ...]
    change: Correction


@dataclass(frozen=True, eq=False)
class Forecast:
    """What an experiment will say.

    Attributes:
        variant: the experiment.
        n_images: its images.
        duration: of the test [s].
        elongation: assumed at the turning points [µm], shape (n_knots,).
        load: predicted at the images next to them [µN], shape (n_knots,).
        parameters: the fitted ones.
        causes: those that the specimen can have.
    """

    variant: Variant
    n_images: int
    duration: float
    elongation: FloatArray
    load: FloatArray
    parameters: tuple[Knowledge, ...]
    causes: tuple[Outlook, ...]

    def sigma(self, name: str) -> float:
        """Return the standard deviation of θ of a parameter, infinite where it is not fitted."""
        return next((p.theta for p in self.parameters if p.name == name), np.inf)


@dataclass(frozen=True, eq=False)
class Prepared:
    """Models and working point of a plan.

    Attributes:
        plan: the plan.
        problem: models, data without images, and priors, as the identification has them.
        values: every parameter, where the model is linearised.
        fitted: names of the parameters that the identification fits.
        causes: those that the specimen can have.
        names: of all parameters whose sensitivities are needed, the fitted ones first.
        history: of the test.
    """

    plan: Plan
    problem: IdentificationProblem
    values: dict[str, float]
    fitted: tuple[str, ...]
    causes: tuple[Cause, ...]
    names: tuple[str, ...]
    history: History


def prepare(plan: Plan) -> Prepared:
    """Models and working point of an experiment.

    Args:
        plan: the experiment.
    """
    case, test = plan.variant.case, plan.variant.test
    surface, noise = _surface(plan)
    images = surface.with_noise(noise, test.repeats)
    history, assumed = _course(plan)
    weights = knot_weights(history)[history.image_row]
    edges = [
        weights @ np.array([0.0, *(assumed[name] for name in names(history.n_knots))])
        for names in (elongation_names, tilt_names)
    ]
    experiment = replace(
        surface.experiment,
        history=history,
        force=np.zeros(history.n_images),
        gamma_F=case.loads.gamma_F,
    )
    # What was wrong in a test that was made is not wrong in one that is planned.
    whole = case.model_copy(update={"loads": case.loads.model_copy(update={"left_out": ()})})
    problem = build_problem(
        whole,
        mesh_of(case, case.specimen.mesh_size),
        mesh_of(case, case.specimen.fine_mesh_size),
        MeasuredSeries(
            experiment,
            images,
            np.zeros((history.n_images, 3)),
            np.zeros((history.n_images, 1, 2)),
            *edges,
        ),
        plan.jobs,
    )
    fitted = (*LAMBDAS, *problem.knots, *problem.law)
    # A knot that is not fitted (a tilt, in the rigid gauge) stays where the identification has it.
    known = {name: value for name, value in assumed.items() if name in problem.knots}
    truth = {name: v for name, v in plan.settings.truth.items() if name not in assumed}
    values = problem.start | truth | known
    wanted = None if case.diagnosis.causes == "all" else case.diagnosis.causes
    causes, names = screened(problem.working, fitted, wanted, user_causes(case))
    return Prepared(plan, problem, values, fitted, causes, names, history)


def simulate(own: Prepared) -> Simulated:
    """Simulate the experiment with all sensitivities, and once more finer with them.

    Raises:
        SolverError: a simulation could not be finished.
    """
    prediction = own.problem.working.predict(own.values, own.names)
    with quiet():
        change = correction(
            own.problem.working,
            own.problem.finer,
            prediction,
            own.values,
            free=own.names,
        )
    return Simulated(prediction, own.names, change)


def can_serve(simulated: Simulated, own: Prepared) -> bool:
    """Whether a simulation of the same specimen and test has all sensitivities that are needed."""
    return set(own.names) <= set(simulated.names)


def forecast(own: Prepared, simulated: Simulated) -> Forecast:
    """Weigh the sensitivities of a simulation with the noise of an experiment."""
    test, case = own.plan.variant.test, own.plan.variant.case
    n_images = own.history.n_images
    index = np.repeat(np.arange(n_images), test.images_per_stop)
    planned = replace(own.problem.objective.data, load=simulated.prediction.load)
    data = planned.frames(index)
    objective = replace(own.problem.objective, data=data, prior=_priors(own))
    if test.exact_simulation:
        objective = replace(objective, correction=simulated.change)
    else:
        sizes = (case.specimen.mesh_size, case.specimen.fine_mesh_size)
        objective = with_correction(objective, 1.0, simulated.change, sizes)
    rows = [simulated.names.index(name) for name in own.names]
    augmented = objective.expect(simulated.prediction.restrict(rows), own.values, own.names)
    fitted = objective.restrict(augmented, own.fitted)
    turning = own.history.turning
    next_image = np.abs(own.history.image_row[None] - turning[:, None]).argmin(axis=1)
    names = elongation_names(own.history.n_knots)
    return Forecast(
        variant=own.plan.variant,
        n_images=index.size,
        duration=float(np.ptp(own.history.time)),
        elongation=np.array([0.0, *(own.values[name] for name in names)]),
        load=simulated.prediction.load[next_image],
        parameters=knowledge(fitted, objective.data, objective.parameters),
        causes=outlooks(own.causes, augmented, fitted, objective.parameters),
    )


def whole_forecast(plan: Plan) -> Forecast:
    """Return the forecast of an experiment that needs a simulation of its own."""
    own = prepare(plan)
    return forecast(own, simulate(own))


def _priors(own: Prepared) -> dict[str, tuple[float, float]]:
    """Those of the identification, and a loose one where it has none."""
    objective: Objective = own.problem.objective
    loose = {name: (own.values[name], LOOSE) for name in own.fitted}
    return loose | dict(objective.prior)


def _surface(plan: Plan) -> tuple[Surface, float]:
    """Return what the images will show, and their noise over that.

    The noise of repeats is measured; a change of `images.noise_nm` changes it in proportion.
    """
    case, base = plan.variant.case, plan.surface.case
    ratio = case.images.noise_nm / base.images.noise_nm
    images = case.images.model_copy(update={"noise_nm": base.images.noise_nm})
    if (images, case.specimen) == (base.images, base.specimen):
        return plan.surface, ratio
    as_noisy = case.model_copy(update={"images": images})
    return expected_surface(as_noisy, plan.settings, plan.history), ratio


def _course(plan: Plan) -> tuple[History, dict[str, float]]:
    """History of the test, and the knots of its motion [µm]."""
    case, test, settings = plan.variant.case, plan.variant.test, plan.settings
    known = knots(plan.history, settings.program, case.specimen.length)
    declared = declared_parameters(
        plan.history.n_knots, case.material.to_material(), n_grains=len(case.grains)
    )
    refuse_unknown(settings.truth, declared)
    known |= {name: value for name, value in settings.truth.items() if name in known}
    if test.compression:
        known = carried_on(known, plan.history, compressed(plan.history))
    return changed(plan.history, test), known

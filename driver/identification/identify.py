"""The identification: λ's and knots from images, the law with loads, then all together.

A. apex amplitudes and knots, from the images alone; the law stays free within its prior, for
   amplitudes fitted under a wrong law would bend to make up for it;
B. parameters of the law, from images and loads, knots free, amplitudes held;
C. all together, with the finer-minus-working correction taken at the result of B, and once more
   at its own where that is far away.

In the paper's order knots stay as correlation found them: A fits amplitudes, B and C the law.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from driver.common.progress import quiet
from driver.forward.model import ForwardModel
from driver.identification.boundary_jitter import boundary_jitter
from driver.identification.correction import Correction, SecondMesh, correction
from driver.identification.cosine_modes import fast_modes
from driver.identification.data import Data
from driver.identification.discretisation_covariance import simulation_error
from driver.identification.fit import Fit, fit, fit_from, to_its_end
from driver.identification.identifiability import refuse_what_is_not_seen
from driver.identification.mesh_error import load_left, share_left
from driver.identification.multistart import Outcome, draw_starts, from_each_start
from driver.identification.objective import Evaluation, Objective
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from meshes.arrays import FloatArray

logger = logging.getLogger(__name__)

Stage = Literal["A", "B", "C"]

START = 0.05  # a stage that only starts the next one ends when its misfit falls by less
HELD = 0.01  # the same of a stage that finds what the next ones hold
FAR = 10.0
"""Way of a fit [σ] from which its correction is taken once more at its end.

A correction with derivatives leaves what goes with the square of the way: 3.6 σ of 47 on alpha.
"""
MOST_CORRECTIONS = 3
_MINUTE = 1e-5  # elongation of a step that stays elastic [µm]


@dataclass(frozen=True, eq=False)
class Plan:
    """How the identification is run.

    Attributes:
        law: names of the law's parameters (and of nuisances of the loads).
        knots: names of the free knots (and of the pose of the specimen in the images).
        sizes: element sizes of the working and of the finer mesh [µm].
        most: largest number of iterations of each stage.
        order: "joint", or "paper" with the knots held.
        jitter: noise of the elongation at each stop, σ_e [µm].
        starts: number of starts.
        spread: standard deviation in θ of the parameters that further starts draw.
        processes: starts side by side.
        threads: threads of each.
    """

    law: tuple[str, ...]
    knots: tuple[str, ...]
    sizes: tuple[float, float]
    most: int
    order: Literal["joint", "paper"] = "joint"
    jitter: float = 0.0
    starts: int = 1
    spread: Mapping[str, float] = field(default_factory=dict)
    processes: int = 1
    threads: int = 1

    def free(self, stage: Stage) -> tuple[str, ...]:
        """Names of the free parameters of a stage."""
        if self.order == "paper":
            return LAMBDAS if stage == "A" else self.law
        return (*self.knots, *self.law) if stage == "B" else self.every

    @property
    def every(self) -> tuple[str, ...]:
        """Names of all that can be free in a stage, or is where the order is joint."""
        return (*LAMBDAS, *self.knots, *self.law)


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of the procedure.

    Attributes:
        objective: model, data, priors and the correction of the last stage.
        stages: the fits of stages A, B and C; without images there is no A.
        law: names of the law's parameters.
        starts: what became of each start, the first of which is that of the case.
    """

    objective: Objective
    stages: Mapping[str, Fit]
    law: tuple[str, ...]
    starts: tuple[Outcome, ...] = ()

    @property
    def final(self) -> Fit:
        """The last fit."""
        return self.stages["C"]


def identify(
    working: ForwardModel,
    finer: ForwardModel,
    objective: Objective,
    start: Mapping[str, float],
    plan: Plan,
) -> Identification:
    """Run stages A, B and C.

    Args:
        working: the model that is fitted.
        finer: finer mesh and steps, for the correction.
        objective: data and priors, without a correction.
        start: every parameter at the start.
        plan: which parameters are free, and how it is run.

    Raises:
        SolverError: the model cannot be evaluated at the start.
        InputError: data and priors leave a combination of parameters open.
    """
    task = _Task(objective, dict(start), plan)
    outcomes: tuple[Outcome, ...] = ()
    if plan.starts == 1:
        first = _first_stages(task)
    else:
        first, outcomes = _best_start(task)
    objective, stage_b = first.objective, first.stage_b
    if "fixed_pattern" in stage_b.best.free:
        objective, patterned = objective.with_pattern_at(stage_b.best)
        stage_b = replace(stage_b, best=patterned)
        working, finer = (replace(m, pattern=objective.model.pattern) for m in (working, finer))
    if plan.jitter:
        logger.info("noise of the boundary motion at the result")
        objective = _with_jitter(objective, stage_b.values, plan.jitter)
    noise = noise_factor(stage_b, first.objective.data)
    free = plan.free("C")
    begin, change = objective.with_free(stage_b.best, free), None
    for turn in range(MOST_CORRECTIONS):
        logger.info("finer mesh and steps at the result, for the correction")
        change = correction(working, finer, begin.prediction, begin.values, free=free, near=change)
        corrected = with_correction(objective, noise, change, plan.sizes)
        again = " of its result" if turn else ""
        logger.info(f"stage C: all together, with the correction{again}")
        last = fit_from(begin, corrected, plan.most)
        if (away := last.away_from(begin, objective.parameters)) < FAR:
            break
        logger.info(f"  it ended {away:.2g} σ from where its correction was taken")
        begin = last.best
    last = to_its_end(last, corrected, plan.most)
    refuse_what_is_not_seen(last.best)
    return Identification(
        corrected, {"A": first.stage_a, "B": stage_b, "C": last}, plan.law, outcomes
    )


@dataclass(frozen=True, eq=False)
class _Task:
    """One start; a share of 0 lets stage B converge."""

    objective: Objective
    start: dict[str, float]
    plan: Plan
    share: float = START


@dataclass(frozen=True, eq=False)
class _First:
    objective: Objective
    stage_a: Fit
    stage_b: Fit


def _first_stages(task: _Task) -> _First:
    objective, plan = task.objective, task.plan
    joint = plan.order == "joint"
    alone = replace(objective, data=objective.data.images_alone())
    if joint:
        logger.info("stage A: apex amplitudes and knots from the images")
        stiffness = elastic_stiffness(objective.model, task.start)
        logger.info(f"  elastic stiffness {1e-3 * stiffness:.1f} µN/nm")
    else:
        logger.info("stage A: apex amplitudes from the images, knots held as measured")

    def unloaded(values: Mapping[str, float]) -> dict[str, float]:
        weights = objective.model.boundary.weights[objective.model.image_row]
        kept = objective.data.load_index
        return unload_elastically(values, stiffness, weights[kept], objective.data.load[kept])

    begin = unloaded(task.start) if joint else task.start
    share = START if joint else HELD
    stage_a = fit(alone, begin, plan.free("A"), plan.most, share=share)
    logger.info(f"stage B: the law from images and loads, knots {'free' if joint else 'held'}")
    values = unloaded(stage_a.values) if joint else stage_a.values
    if plan.jitter and objective.data.jitter is None:
        objective = _with_jitter(objective, values, plan.jitter)
    known = None if joint else objective.with_free(stage_a.best, plan.free("B"))
    stage_b = fit(objective, values, plan.free("B"), plan.most, start=known, share=task.share)
    return _First(objective, stage_a, stage_b)


def _best_start(task: _Task) -> tuple[_First, tuple[Outcome, ...]]:
    plan = task.plan
    if plan.jitter:
        # One covariance for all: under their own their costs could not be compared.
        shared = _with_jitter(task.objective, task.start, plan.jitter)
        task = replace(task, objective=shared)
    drawn = draw_starts(task.start, task.objective.parameters, plan.spread, plan.starts)
    tasks = [replace(task, start=start, share=0.0) for start in drawn]
    return from_each_start(
        _from_a_start, tasks, lambda first: first.stage_b, plan.law, plan.processes,
        plan.threads,
    )  # fmt: skip


@quiet()
def _from_a_start(task: _Task) -> _First:
    return _first_stages(task)


def _with_jitter(objective: Objective, values: Mapping[str, float], sigma: float) -> Objective:
    jitter = boundary_jitter(objective.model, objective.data.image, values, sigma)
    return replace(objective, data=replace(objective.data, jitter=jitter))


def knot_start(weights: FloatArray, motion: FloatArray, names: Sequence[str]) -> dict[str, float]:
    """Least-squares knots of a measured difference between the edges [µm], first knot at zero.

    Args:
        weights: knot weights at the images, shape (T, n_knots).
        motion: measured difference at each image, shape (T,).
        names: names of the knots after the first.
    """
    # The unloaded state is knot 0; the measured motion may carry the noise of the reference.
    knots = np.linalg.lstsq(weights, motion, rcond=None)[0]
    return dict(zip(names, (knots - knots[0])[1:].tolist(), strict=True))


def with_correction(
    objective: Objective,
    noise_factor: float,
    change: Correction,
    sizes: tuple[float, float],
    second: SecondMesh | None = None,
) -> Objective:
    """Return objective with a correction, the covariance of what it leaves wrong, and the noise.

    Two finer meshes as good as each other leave what either does.

    Args:
        objective: data and priors.
        noise_factor: noise of the images over that of the repeats.
        change: finer minus working prediction.
        sizes: element sizes of the working and of the finer mesh [µm].
        second: what a second finer mesh says beside it, None where there is none.
    """
    image = replace(objective.data.image, noise_factor=noise_factor)
    whole = change.with_second(second)
    objective = replace(objective, correction=whole, second=second)
    behind = objective.sizes_behind(sizes)
    left_by = whole if second is not None and second.is_better else change
    mesh, (motion, load) = objective.model.microstructure.mesh, left_by.of_mesh
    left = load_left(mesh, behind, load, objective.data.load)
    error = simulation_error(image, motion, left, behind[1], share_left(mesh, behind))
    data = replace(
        objective.data, image=image, simulation_error=error, step_error=change.left_by_steps
    )
    return replace(objective, data=data)


def corrected_with_derivatives(
    objective: Objective, finer: ForwardModel, at: Evaluation, sizes: tuple[float, float]
) -> tuple[Objective, Evaluation]:
    """Return the objective with the correction at an evaluation, and its derivatives there.

    Args:
        objective: with a correction taken elsewhere; returned as it is where derivatives cost
            further simulations.
        finer: the finer model.
        at: an evaluation with every parameter free that may ever be.
        sizes: element sizes of the working and of the finer mesh [µm].

    Returns:
        The objective, and what the evaluation is under it.

    Raises:
        SolverError: the finer simulation could not be finished.
    """
    if finer.adapter.capabilities().runs_per_direction:
        return objective, at
    logger.info("finer mesh and steps at the result, with all derivatives")
    change = correction(
        objective.model, finer, at.prediction, at.values, free=at.free,
        near=objective.correction,
    )  # fmt: skip
    objective = with_correction(objective, objective.data.image.noise_factor, change, sizes)
    return objective, objective.compare(at.prediction, at.values, at.free)


def elastic_stiffness(model: ForwardModel, values: Mapping[str, float]) -> float:
    """Force per elongation of the unyielded specimen [µN/µm], from one minute step."""
    first = elongation_names(model.boundary.weights.shape[1])[0]
    unit = model.boundary.derivative(values, first)
    peak = int(np.argmax(np.abs(unit).max(axis=(1, 2))))
    motion = np.stack([np.zeros_like(unit[peak]), _MINUTE * unit[peak]])
    simulation = replace(
        model.simulation(values), times=np.array([0.0, 1.0]), motion=motion, output=np.array([1])
    )
    return float(model.adapter.solve(simulation, model.workspace).force[0]) / _MINUTE


def unload_elastically(
    values: Mapping[str, float], stiffness: float, weights: FloatArray, load: FloatArray
) -> dict[str, float]:
    """Elongation knots after which each unloading is as long as its drop of load says.

    Correlation resolves tens of nanometres, the loads a tenth of one: a start with a wrong
    unloading has a load residual of hundreds of standard deviations, far from linear.

    Args:
        values: every parameter.
        stiffness: elastic force per elongation [µN/µm].
        weights: knot weights at the images whose loads are fitted, shape (n_load, n_knots).
        load: these loads [µN], shape (n_load,).
    """
    names = elongation_names(weights.shape[1])
    knots = [0.0, *(values[name] for name in names)]
    at_knot = [float(load[int(np.argmax(weights[:, k]))]) for k in range(weights.shape[1])]
    for k in range(1, len(knots)):
        drop = at_knot[k - 1] - at_knot[k]
        if drop > 0:
            knots[k] = knots[k - 1] - drop / stiffness
    return dict(values) | dict(zip(names, knots[1:], strict=True))


def noise_factor(fit_: Fit, data: Data) -> float:
    """Noise of the images over that they were whitened with, from the fast half of their spectrum.

    A model error is slow, noise is white: the estimate does not need the model to be right.
    """
    z = data.image_part(fit_.best.residual)
    return float(np.sqrt(np.mean((fast_modes(len(z)) @ z) ** 2)))


def start_values(
    model: ForwardModel, elongation: FloatArray, tilt: FloatArray
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Null values with knots from the measured edges; names of the free knots.

    Args:
        model: the forward model.
        elongation: v(S+) − v(S−) of each image [µm], shape (T,).
        tilt: w(S+) − w(S−) of each image [µm], shape (T,).
    """
    weights = model.boundary.weights[model.image_row]
    n = weights.shape[1]
    along, out = elongation_names(n), tilt_names(n)
    values = model.null_values()
    values |= knot_start(weights, elongation, along) | knot_start(weights, tilt, out)
    return values, (*along, *out)

"""The identification: λ's and knots from images, the law with loads, then all together.

A. apex amplitudes and knots, from the images alone; the law stays free within its prior, for
   amplitudes fitted under a wrong law would bend to make up for it;
B. parameters of the law, from images and loads, knots free, amplitudes held;
C. all together, with the finer-minus-working correction taken at the result of B.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from driver.boundary import LAMBDAS, elongation_names, tilt_names
from driver.identification.data import Data
from driver.identification.fit import Correction, Fit, Objective, fit
from driver.identification.simulation_error import simulation_error
from driver.model import ForwardModel

FloatArray = NDArray[np.float64]
Log = Callable[[str], None]

START = 0.05  # a stage that only starts the next one ends when its misfit falls by less
_MINUTE = 1e-5  # elongation of a step that stays elastic [µm]
LAMBDA_PRIOR = 0.2  # standard deviation about the start: the paper found 0.81, 1.02, 0.98, 1.02


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of the procedure.

    Attributes:
        objective: model, data, priors and the correction of the last stage.
        stages: the fits of stages A, B and C.
    """

    objective: Objective
    stages: Mapping[str, Fit]

    @property
    def final(self) -> Fit:
        """The last fit."""
        return self.stages["C"]


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


def identify(
    working: ForwardModel,
    finer: ForwardModel,
    objective: Objective,
    start: Mapping[str, float],
    law: Sequence[str],
    knots: Sequence[str],
    sizes: tuple[float, float],
    most: int,
    log: Log,
) -> Identification:
    """Run stages A, B and C.

    Args:
        working: the model that is fitted.
        finer: finer mesh and steps, for the correction.
        objective: data and priors, without a correction.
        start: every parameter at the start.
        law: names of the law's parameters (and of nuisances of the loads).
        knots: names of the free knots.
        sizes: element sizes of the working and of the finer mesh [µm].
        most: largest number of iterations of each stage.
        log: takes one line of progress.

    Raises:
        SolverError: the model cannot be evaluated at the start.
    """
    log("stage A: apex amplitudes and knots from the images")
    stiffness = elastic_stiffness(working, start)
    log(f"  elastic stiffness {1e-3 * stiffness:.1f} µN/nm")
    weights = working.boundary.weights[working.image_row]
    load = objective.data.load
    start = unload_elastically(start, stiffness, weights, load)
    images_alone = replace(objective, data=objective.data.images_alone())
    everything = (*LAMBDAS, *knots, *law)
    stage_a = fit(images_alone, start, everything, most, log, share=START)
    log("stage B: the law from images and loads, knots free")
    unloaded = unload_elastically(stage_a.values, stiffness, weights, load)
    stage_b = fit(objective, unloaded, (*knots, *law), most, log, share=START)
    log("finer mesh and steps at the result, for the correction")
    noise = temporal_noise(stage_b, objective.data)
    change = correction(working, finer, stage_b, log)
    corrected = with_correction(objective, noise, change, sizes)
    log("stage C: all together, with the correction")
    last = fit(corrected, stage_b.values, everything, most, log)
    return Identification(corrected, {"A": stage_a, "B": stage_b, "C": last})


def with_correction(
    objective: Objective, noise_factor: float, change: Correction, sizes: tuple[float, float]
) -> Objective:
    """The objective with a correction, the covariance of what it leaves wrong, and the noise.

    Args:
        objective: data and priors.
        noise_factor: noise of the images over that of the repeats.
        change: finer minus working prediction.
        sizes: element sizes of the working and of the finer mesh [µm].
    """
    image = replace(objective.data.image, noise_factor=noise_factor)
    error = simulation_error(
        image, np.asarray(change.motion), np.asarray(change.load), sizes[1], sizes[1] / sizes[0]
    )
    data = replace(objective.data, image=image, simulation_error=error)
    return replace(objective, data=data, correction=change)


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
        weights: knot weights at the images, shape (T, n_knots).
        load: measured loads [µN], shape (T,).
    """
    names = elongation_names(weights.shape[1])
    knots = [0.0, *(values[name] for name in names)]
    at_knot = [float(load[int(np.argmax(weights[:, k]))]) for k in range(weights.shape[1])]
    for k in range(1, len(knots)):
        drop = at_knot[k - 1] - at_knot[k]
        if drop > 0:
            knots[k] = knots[k - 1] - drop / stiffness
    return dict(values) | dict(zip(names, knots[1:], strict=True))


def correction(working: ForwardModel, finer: ForwardModel, at: Fit, log: Log) -> Correction:
    """Finer minus working prediction at a result."""
    fine = finer.predict(at.values)
    coarse = at.best.prediction
    motion = fine.motion - coarse.motion
    load = fine.load - coarse.load
    log(
        f"  finer − working: load {np.sqrt(np.mean(load**2)):.2f} µN rms, "
        f"motion {1e3 * np.sqrt(np.mean(motion**2)):.2f} nm rms"
    )
    return Correction(motion, load)


def temporal_noise(fit_: Fit, data: Data) -> float:
    """Noise of the whitened images from the fast half of their spectrum in time.

    A model error is slow, noise is white: the estimate does not need the model to be right.
    """
    z = data.image_part(fit_.best.residual)
    T = len(z)
    row = np.arange(T)
    modes = np.sqrt(2 / T) * np.cos(np.pi * np.outer(np.arange(T // 2, T), row + 0.5) / T)
    return float(np.sqrt(np.mean((modes @ z) ** 2)))


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

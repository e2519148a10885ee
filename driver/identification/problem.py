"""What identification and diagnosis start from, put together from a case and earlier results."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from driver.case.model import Case
from driver.dic.basis import basis_on
from driver.dic.surface_images import SurfaceImages, refine_gradient
from driver.experiment.reading import Experiment
from driver.forward.build import (
    adapter_of,
    build_finer_model,
    build_model,
    correlation_meshes,
    second_mesh_of,
)
from driver.forward.cost import foreseen_seconds
from driver.forward.fixed_pattern import apparent_rise
from driver.forward.model import ForwardModel
from driver.forward.progress_adapter import ProgressAdapter
from driver.identification.data import Data
from driver.identification.identify import Plan, start_values
from driver.identification.image_data import build_image_data, reweighted
from driver.identification.missing_pixels import lacking_pixels
from driver.identification.objective import Objective
from driver.identification.priors import FREED_WIDTH, Prior, prior_of, widths
from driver.parameters.boundary import AMPLITUDE_DECLARATIONS
from driver.parameters.instrument import LOAD_DECLARATIONS
from driver.parameters.pose import POSE_DECLARATIONS
from meshes.arrays import BoolArray, FloatArray
from meshes.prism_mesh import PrismMesh
from solver_adapters.interface import Adapter

_PLACES = 25  # at which the motion of the specimen over the camera is followed


@dataclass(frozen=True, eq=False)
class IdentificationProblem:
    """Models, data and starts of a case.

    Attributes:
        experiment: what was measured.
        images: the corrected images with the low-noise gradient.
        working: the model that is fitted.
        finer: finer mesh and steps.
        objective: data, priors; no correction yet.
        start: every parameter at the start.
        plan: which parameters are free, and how the identification is run.
    """

    experiment: Experiment
    images: SurfaceImages
    working: ForwardModel
    finer: ForwardModel
    objective: Objective
    start: dict[str, float]
    plan: Plan

    @property
    def law(self) -> tuple[str, ...]:
        """Names of the free parameters of law, section and extensions."""
        return self.plan.law

    @property
    def knots(self) -> tuple[str, ...]:
        """Names of the free knots, and of the position of the specimen in the images."""
        return self.plan.knots


@dataclass(frozen=True, eq=False)
class MeasuredSeries:
    """An experiment with what correlation says of it, T images.

    Attributes:
        experiment: history and loads; its frames are not looked at any more.
        images: the corrected images with the low-noise gradient.
        mean_motion: mean motion of each image [µm], shape (T, 3).
        places: displacement of some places of the specimen [µm], shape (T, p, 2).
        elongation: measured v(S+) − v(S−) of each image [µm], shape (T,).
        tilt: measured w(S+) − w(S−) of each image [µm], shape (T,).
        left_out: frames whose images are not fitted.
        rise: what the pattern of the flats, left in the images, would do to them, as
            `apparent_rise` gives it [µm], shape (T, n_pix), or None without flats.
        lacking: which pixels say nothing in which frame, (T, n_pix), or None.
    """

    experiment: Experiment
    images: SurfaceImages
    mean_motion: FloatArray
    places: FloatArray
    elongation: FloatArray
    tilt: FloatArray
    left_out: tuple[int, ...] = ()
    rise: FloatArray | None = None
    lacking: BoolArray | None = None


def seen_by_correlation(
    experiment: Experiment,
    images: SurfaceImages,
    motion: FloatArray,
    elongation: FloatArray,
    tilt: FloatArray,
    left_out: tuple[int, ...] = (),
) -> MeasuredSeries:
    """Return the experiment of a case, its gradient refined along the measured motion.

    Args:
        experiment: what was measured.
        images: the corrected images.
        motion: motion of the free correlation at the pixels [µm], shape (T, n_pix, 3).
        elongation: as in `MeasuredSeries`.
        tilt: as in `MeasuredSeries`.
        left_out: as in `MeasuredSeries`.
    """
    # An identification asks for every frame many times.
    images = refine_gradient(images.kept(), motion)
    rise = apparent_rise(images, motion)
    lacking = lacking_pixels(images, motion)
    some = np.linspace(0, motion.shape[1] - 1, _PLACES).astype(np.int64)
    places = motion[:, some, :2]
    return MeasuredSeries(
        experiment, images, motion.mean(axis=1), places, elongation, tilt, left_out, rise, lacking
    )


def on_second_mesh(case: Case, problem: IdentificationProblem) -> ForwardModel:
    """Return the finer model on the second mesh, which may contradict the first.

    Raises:
        InputError: the prism cannot be meshed with such elements.
    """
    finer, history = problem.finer, problem.experiment.history
    mesh = second_mesh_of(case, finer.microstructure.mesh.points)
    second = build_finer_model(
        case, mesh, history, problem.images.xy, finer.adapter, finer.workspace
    )
    return replace(second, pattern=finer.pattern)


def build_problem(
    case: Case,
    mesh: PrismMesh,
    fine_mesh: PrismMesh,
    seen: MeasuredSeries,
    jobs: Path | None = None,
    keeping: Callable[[Adapter], Adapter] = lambda solver: solver,
    prepare_only: bool = False,
) -> IdentificationProblem:
    """Put a case together.

    Args:
        case: the case.
        mesh: working mesh.
        fine_mesh: finer mesh.
        seen: what was measured.
        jobs: folder of the jobs of a solver that is a program of its own, or None.
        keeping: makes the solver keep its responses.
        prepare_only: whether they are written for another machine instead of being run.
    """
    experiment, images, left_out = seen.experiment, seen.images, seen.left_out
    solver = keeping(adapter_of(case, prepare_only))
    adapter = ProgressAdapter(solver, partial(foreseen_seconds, case, solver.capabilities()))
    history = experiment.history
    jobs = jobs if adapter.capabilities().uses_workspace else None
    steps = case.solver.steps_per_interval
    working = build_model(case, mesh, history, images.xy, adapter, steps, jobs)
    working = replace(working, pattern=seen.rise)
    finer = build_finer_model(case, fine_mesh, history, images.xy, adapter, jobs)
    finer = replace(finer, pattern=seen.rise)
    pixel = case.images.pixel_um
    mesh_uv, mesh_w = correlation_meshes(case)
    image_data = build_image_data(
        images,
        basis_on(images.xy, images.bounds, mesh_uv),
        basis_on(images.xy, images.bounds, mesh_w),
        seen.mean_motion,
        case.boundary.gauge,
        seen.places,
        seen.lacking,
    )
    if experiment.noise_map is not None:
        image_data = reweighted(image_data, experiment.noise_map[images.rows, images.cols] ** 2)
    data = Data(
        image_data,
        experiment.force,
        experiment.gamma_F,
        case.loads.autocorrelation,
        np.arange(history.n_images),
        left_out=left_out,
        stated_bad_loads=case.loads.left_out,
    )
    parameters = working.parameters
    # A frame that is the reference has no image to fit, but stands still.
    unknown = tuple(t for t in left_out if not images.is_reference[t])
    elongation, tilt = (_without(unknown, values) for values in (seen.elongation, seen.tilt))
    start, knots = start_values(working, elongation, tilt)
    if case.boundary.gauge == "rigid":
        # The tilt between the edges is a rigid rotation, and is not part of the motion.
        knots = tuple(name for name in knots if name.startswith("elongation"))
        start |= {name: 0.0 for name in start if name.startswith("tilt_") and name[5:].isdigit()}
    start = stated_start(case, start)
    n_images, n_pixels = history.n_images - len(left_out), len(images.xy)
    prior = stated_prior(case, start, working, n_images, n_pixels)
    pose = tuple(parameter.name for parameter in POSE_DECLARATIONS)
    half_a_pixel = case.images.origin_uncertainty_px * pixel
    prior |= {name: (0.0, half_a_pixel / parameters[name].scale) for name in pose}
    return IdentificationProblem(
        experiment=experiment,
        images=images,
        working=working,
        finer=finer,
        objective=Objective(working, data, parameters, prior),
        start=start,
        plan=Plan(
            law=law_of(case),
            knots=(*pose, *knots),
            sizes=(case.specimen.mesh_size, case.specimen.fine_mesh_size),
            most=case.identification.max_iterations,
            order=case.identification.order,
            jitter=case.boundary.jitter,
            starts=case.identification.starts,
            spread=widths(case.identification, parameters),
            processes=case.execution.processes,
            threads=case.execution.threads,
        ),
    )


def _without(left_out: tuple[int, ...], values: FloatArray) -> FloatArray:
    """Return a series with the values of some frames taken from their neighbours, shape (T,)."""
    frames = np.arange(values.size)
    kept = np.setdiff1d(frames, left_out)
    return np.asarray(np.interp(frames, kept, values[kept]))


def stated_start(case: Case, values: Mapping[str, float]) -> dict[str, float]:
    """Every parameter at the start: these values, and those that the case states instead."""
    amplitudes = {one.name: case.value_at(one.key) for one in AMPLITUDE_DECLARATIONS}
    return {**values, **amplitudes, **case.extensions}


def stated_prior(
    case: Case, start: Mapping[str, float], model: ForwardModel, n_images: int, n_pixels: int
) -> Prior:
    """Mean (value) and standard deviation (in θ) of amplitudes, law, extensions and load cell.

    Args:
        case: the case.
        start: every parameter at the start.
        model: the working model.
        n_images: images that are fitted; loads where there is no image.
        n_pixels: pixels of each.
    """
    parameters, null = model.parameters, model.null_values()
    prior = prior_of(case.identification, start, parameters, n_images, n_pixels)
    for name in case.extensions:
        prior[name] = (null[name], FREED_WIDTH * parameters[name].width)
    stated = load_uncertainties(case)
    return prior | {name: (0.0, u / parameters[name].scale) for name, u in stated.items()}


def law_of(case: Case) -> tuple[str, ...]:
    """Names of the free parameters of law, load cell and extensions."""
    names = (*case.identification.parameters, *case.extensions, *load_uncertainties(case))
    return tuple(dict.fromkeys(names))


def load_uncertainties(case: Case) -> dict[str, float]:
    """Stated standard deviations of what the load cell makes of the force, by parameter."""
    stated = {
        one.name: case.value_at(one.deviation_key) for one in LOAD_DECLARATIONS if one.deviation_key
    }
    return {name: deviation for name, deviation in stated.items() if deviation}

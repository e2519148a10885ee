"""Do the stated intervals cover the truth? Virtual experiments with truths drawn from the prior.

A draw is a whole experiment: law, apex amplitudes and origin from the prior that the
identification states, knots from a range (they have no prior), relief, stage and noise of its own;
simulated on a finer mesh with smaller steps, photographed in 8 bits, correlated, and identified by
the full nonlinear procedure from the case's starts. The specimen is short and its images few, so
that a draw costs some seconds.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from driver.case.images import Images
from driver.case.inference import Identification
from driver.case.material import MaterialTable
from driver.case.model import Case, load_case
from driver.case.solver import Solver
from driver.common.parallel import side_by_side
from driver.dic.elongation import edge_motion
from driver.dic.series import measure
from driver.experiment.history import History
from driver.experiment.reading import read_experiment
from driver.forward.build import mesh_of, surface_images
from driver.identification.identify import identify
from driver.identification.priors import LAMBDA_PRIOR
from driver.identification.problem import IdentificationProblem, build_problem, seen_by_correlation
from driver.parameters.boundary import LAMBDAS, elongation_names, tilt_names
from driver.virtual.command import true_case
from driver.virtual.settings import Discretisation, Virtual
from driver.virtual.truth import pull, stage_program
from driver.virtual.writing import record
from meshes.arrays import FloatArray
from meshes.prism_mesh import PrismMesh
from tools.short_specimen import GRAINS, short_prism

Draw = dict[str, Any]

LAW = ("tau0", "c", "d")
WIDTH = 0.3  # prior of log τ0, log c, log d
CYCLES = ((5, 2), (5, 2))
LARGEST, RECOVERED = (0.010, 0.020), (4e-4, 8e-4)  # ranges of the strains [-]
TILT = (-0.5, 0.5)  # range of the tilt over the elongation
NORMAL_95 = 1.959964
GOAL = (0.90, 0.98)


def believed() -> Case:
    """Return the case that every draw is identified with."""
    return Case(
        specimen=short_prism(6.0, 1.4),
        grains=GRAINS,
        material=MaterialTable(strain_measure="small", tau0_MPa=25.0, c_MPa=44e3, d=1140.0),
        images=Images(frames="images.tif"),
        solver=Solver(steps_per_interval=1, fine_steps_per_interval=2),
        identification=Identification(prior_width=dict.fromkeys(LAW, WIDTH)),
    )


SETTINGS = Virtual(discretisation=Discretisation(mesh_size_um=1.0, steps_per_interval=3))


def study() -> str:
    """Return name of the study that changes with all that a draw depends on beside the program."""
    ranges = [CYCLES, LARGEST, RECOVERED, TILT]
    parts = [believed().model_dump(mode="json"), SETTINGS.model_dump(mode="json"), ranges]
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]


def drawn_truth(rng: np.random.Generator, history: History) -> dict[str, float]:
    """Return true values: law, λ's and origin by the prior, knots in their ranges."""
    case = believed()
    start = case.material.to_material()
    values = {name: getattr(start, name) * np.exp(WIDTH * rng.normal()) for name in LAW}
    values |= {name: 1.0 + LAMBDA_PRIOR * rng.normal() for name in LAMBDAS}
    origin = case.images.origin_uncertainty_px * case.images.pixel_um
    values |= {name: origin * rng.normal() for name in ("origin_X", "origin_Y")}
    length, n = case.specimen.length, history.n_knots
    largest, tilt = rng.uniform(*LARGEST) * length, rng.uniform(*TILT)
    stage = history.stage[history.turning]
    loaded = largest * stage / stage.max()
    for k, (stretch, lean) in enumerate(zip(elongation_names(n), tilt_names(n), strict=True), 1):
        unloads = stage[k] < stage[k - 1]
        back = rng.uniform(*RECOVERED) * length if unloads else 0.0
        values[stretch] = loaded[k - 1] - back if unloads else loaded[k]
        values[lean] = tilt * values[stretch]
    return {name: float(value) for name, value in values.items()}


def draw(seed: int) -> Draw:
    """One virtual experiment and its identification."""
    began = time.process_time()
    rng, history = np.random.default_rng([seed, 7]), stage_program(CYCLES)
    truth = drawn_truth(rng, history)
    course = pull(true_case(believed(), SETTINGS), history, truth)
    made = time.process_time()
    # The origin is one of the drawn parameters: the stage adds no error of its own.
    microscope = SETTINGS.microscope.model_copy(update={"origin_error_px": 0.0})
    settings = SETTINGS.model_copy(update={"microscope": microscope})
    with tempfile.TemporaryDirectory() as folder:
        problem = measured_problem(
            load_case(record(Path(folder), believed(), course, seed, settings))
        )
    measured = time.process_time()
    identification = identify(
        problem.working,
        problem.finer,
        problem.objective,
        problem.start,
        problem.plan,
    )
    final = identification.final
    return {
        "study": study(),
        "seed": seed,
        "truth": {name: truth[name] for name in final.best.free},
        "value": {name: final.values[name] for name in final.best.free},
        "sigma": {n: final.sigma(n, problem.objective.parameters) for n in final.best.free},
        "chi_load": final.best.chi_load,
        "chi_image": final.best.chi_image,
        "converged": final.converged,
        "iterations": [len(stage.history) - 1 for stage in identification.stages.values()],
        "cpu": [made - began, measured - made, time.process_time() - measured],
    }


def measured_problem(case: Case) -> IdentificationProblem:
    """Correlate the images of a case, and put its identification together."""
    experiment = read_experiment(case)
    images = surface_images(case, experiment)
    pixel = case.images.pixel_um
    motion = measure(images, case.dic.element_px * pixel, case.dic.height_element_px * pixel)
    lower, upper = images.bounds[2:]
    edges = edge_motion(motion, images, lower, upper)
    reach = case.specimen.length / (upper - lower)
    seen = seen_by_correlation(
        experiment, images, motion.at_pixels(), reach * edges.elongation, reach * edges.tilt
    )
    return build_problem(case, *_meshes(), seen)


@cache
def _meshes() -> tuple[PrismMesh, PrismMesh]:
    case = believed()
    specimen = case.specimen
    return mesh_of(case, specimen.mesh_size), mesh_of(case, specimen.fine_mesh_size)


def finished(path: Path) -> list[Draw]:
    """Return the draws of this study that a file holds, one for each seed."""
    if not path.is_file():
        return []
    lines = [json.loads(line) for line in path.read_text("utf-8").splitlines() if line.strip()]
    return list({drawn["seed"]: drawn for drawn in lines if drawn["study"] == study()}.values())


def run(path: Path, draws: int, processes: int) -> list[Draw]:
    """Make what is missing of the first so many draws; each is appended to the file as it ends."""
    there = {one["seed"] for one in finished(path)}
    missing = [seed for seed in range(draws) if seed not in there]
    path.parent.mkdir(parents=True, exist_ok=True)

    def keep(index: int, one: Draw) -> None:
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(one) + "\n")
        cpu = " + ".join(f"{seconds:.1f}" for seconds in one["cpu"])
        print(f"  draw {one['seed']}: {cpu} CPU-s, {len(there) + index + 1} there", flush=True)

    if missing:
        print(f"  {len(there)} of {draws} draws are in {path}; {len(missing)} to make", flush=True)
        side_by_side(draw, missing, processes, done=keep)
    return [one for one in finished(path) if one["seed"] < draws]


@dataclass(frozen=True)
class Coverage:
    """What the draws say of one parameter or of a group.

    Attributes:
        share: of the truths inside the stated 95 % intervals.
        spread: root mean square of (value − truth)/σ.
        n: number of intervals.
    """

    share: float
    spread: float
    n: int


def coverage(draws: list[Draw]) -> Mapping[str, Coverage]:
    """Coverage by parameter, and of law and λ's, of knots and of all together."""
    names = tuple(draws[0]["value"])
    off = {name: np.array([_deviation(line, name) for line in draws]) for name in names}
    groups: dict[str, tuple[str, ...]] = {name: (name,) for name in names}
    groups |= {
        "law and lambdas": (*LAW, *LAMBDAS),
        "knots": tuple(name for name in names if name.startswith(("elongation", "tilt"))),
        "all": names,
    }
    return {group: _coverage(np.concatenate([off[n] for n in of])) for group, of in groups.items()}


def _deviation(one: Draw, name: str) -> float:
    return float((one["value"][name] - one["truth"][name]) / one["sigma"][name])


def _coverage(deviations: FloatArray) -> Coverage:
    inside = float(np.mean(np.abs(deviations) <= NORMAL_95))
    return Coverage(inside, float(np.sqrt(np.mean(deviations**2))), deviations.size)

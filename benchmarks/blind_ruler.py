"""How large an effect is, in σ of what a fit leaves of it; and truths of a wanted size.

The ruler is an experiment without an effect, identified as any other. It serves the plan of the
trial alone: no diagnosis ever sees it.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import h5py
import numpy as np

from benchmarks.blind_specimen import (
    LARGEST,
    PER_SIGMA,
    ROUGHLY,
    known_case,
    null_values,
    outside,
)
from benchmarks.blind_store import kept
from driver.case.model import load_case
from driver.common.errors import InputError
from driver.diagnosis.causes.causes import Cause
from driver.diagnosis.statistics.score_test import Score, effects_of, subspace_similarity
from driver.diagnosis.statistics.screening import screen, screened
from driver.identification.fit import Fit
from driver.identification.objective import Evaluation, Objective
from driver.results.files import IDENTIFY, RESULTS
from driver.results.hdf5 import read_hdf5
from driver.virtual.microscope.face_motion import Face, NodalMotion
from driver.virtual.truth import Course
from driver.virtual.writing import record
from driver.workflow.engine import StageContext
from driver.workflow.identify_stage import load_problem, saved_objective
from driver.workflow.pipeline import run
from meshes.arrays import FloatArray
from solver_adapters.interface import SolverError
from tools.converged_truth import OF_EFFECTS, pulled

RULER_SEED = 987_654
CLOSE = 0.14  # relative error of the size of a truth that is good enough
TRIES = 4
MOST_SCALES = 4.0
"""Prior scales beyond which nothing is hidden where nothing else is said: one effect in sixty is as
large, and a diagnosis that weighs causes by these priors is right to think of another one first."""
ALIKE = 0.95  # likeness beyond which two causes do the same to the data


class TooSmallError(ValueError):
    """No value inside the bounds makes an effect as large as wanted."""


@dataclass(frozen=True, eq=False)
class Ruler:
    """An identified experiment without an effect.

    Attributes:
        objective: of the last stage.
        here: evaluation at the fit, of the fitted parameters.
        augmented: the same with the parameters of all causes free.
        causes: of the library, that this specimen can have.
        unaffected: the course without an effect.
    """

    objective: Objective
    here: Evaluation
    augmented: Evaluation
    causes: tuple[Cause, ...]
    unaffected: Course

    def misfit(self, course: Course, cause: str | None = None) -> float:
        """Return what a fit of the baseline leaves of the effect of a course [σ].

        Args:
            course: what happened.
            cause: name of a cause, if only that part counts which looks, to first order, like
                it. The rest is no sign of the cause: its curvature, and that meshes answer to it
                each in its way, which is as large as a third of an effect.
        """
        change = shown(course, self.objective) - shown(self.unaffected, self.objective)
        data, here = self.objective.data, self.here
        with_it = data.residual(
            here.motion + change, here.load + course.load - self.unaffected.load
        )
        of_course = with_it[0] - here.residual
        if cause is None:
            return self._left_of(of_course)
        # The directions stand across all that the fit can take.
        return float(np.linalg.norm(self._scores[cause].directions @ of_course))

    def length(self, cause: Cause, direction: FloatArray) -> float:
        """Linear misfit for a step of one along a direction in prior scales [σ]."""
        rows = [self.augmented.free.index(name) for name in cause.parameters]
        scales = [self.objective.parameters[name].width for name in cause.parameters]
        step = np.asarray(direction * np.array(scales)) @ self.augmented.jacobian[rows]
        return self._left_of(np.asarray(step))

    def reach(self, cause: Cause, direction: FloatArray) -> float:
        """Return the largest effect along a direction within the prior, to first order [σ]."""
        most = min(MOST_SCALES, self.largest(cause, direction))
        return most * self.length(cause, direction)

    def largest(self, cause: Cause, direction: FloatArray) -> float:
        """How many prior scales along a direction the bounds allow."""
        nulls, most = null_values(), np.inf
        for name, share in zip(cause.parameters, direction, strict=True):
            p = self.objective.parameters[name]
            bound = p.upper if share > 0 else p.lower
            if np.isfinite(bound) and share and not (p.logarithmic and bound <= 0):
                per_size = share * p.width
                most = min(most, p.theta(bound, nulls[name]) / per_size)
        return float(most)

    def _left_of(self, change: FloatArray) -> float:
        J = self.here.jacobian
        taken = J.T @ np.linalg.solve(self.here.hessian, J @ change)
        return float(np.sqrt(max(float(change @ (change - taken)), 0.0)))

    @cached_property
    def _scores(self) -> dict[str, Score]:
        baseline = Fit(self.here, True, "", ())
        effects = effects_of(self.causes, self.augmented, self.objective.parameters)
        sizes = known_case().specimen.mesh_size, known_case().specimen.fine_mesh_size
        scores, _ = screen(baseline, self.objective, self.causes, effects, sizes)
        return {score.cause.name: score for score in scores}

    @cached_property
    def alike(self) -> dict[str, tuple[str, ...]]:
        """The causes that do the same to these data, each with itself among them."""
        scores = self._scores.values()
        return {
            s.cause.name: tuple(
                o.cause.name for o in scores if o is s or subspace_similarity(s, o) > ALIKE
            )
            for s in scores
        }

    def values(self, cause: Cause, direction: FloatArray, size: float) -> dict[str, float]:
        """Values of its parameters `size` prior scales along a direction, inside their bounds."""
        nulls, values = null_values(), {}
        for name, share in zip(cause.parameters, direction, strict=True):
            p = self.objective.parameters[name]
            theta = size * share * p.width
            values[name] = float(p.value(theta, nulls[name]))
        return values


@lru_cache(maxsize=1)
def ruler(cache: Path) -> Ruler:
    """Return the ruler, made if it is not there: about a minute of one core."""
    return kept(cache / "ruler.pickle", lambda: _made(cache))


def _made(cache: Path) -> Ruler:
    unaffected = kept(cache / "nothing.pickle", lambda: pulled({}))
    folder = cache / "ruler"
    folder.mkdir(exist_ok=True)
    path = folder / "case.toml"
    if not path.is_file():
        record(folder, known_case(), unaffected, RULER_SEED)
    run(path, "identify", False)
    objective, values, free = identified(path)
    causes, names = screened(objective.model, free, None)
    objective, augmented = objective.with_pattern_at(objective.evaluate(values, names))
    return Ruler(objective, objective.restrict(augmented, free), augmented, causes, unaffected)


def identified(path: Path) -> tuple[Objective, dict[str, float], tuple[str, ...]]:
    """Objective, values and fitted parameters of a case that has been identified."""
    results = path.parent / RESULTS
    problem = load_problem(StageContext(load_case(path), results, results, False))
    with h5py.File(results / IDENTIFY, "r") as file:
        values: dict[str, float] = json.loads(file.attrs["all_values"])
        free = tuple(json.loads(file.attrs["names"]))
    return saved_objective(problem, read_hdf5(results / IDENTIFY)), values, free


@dataclass(frozen=True, eq=False)
class Truth:
    """A course with an effect of about the wanted size.

    Attributes:
        course: what happened.
        misfit: what a fit of the baseline leaves of it [σ]; of a cause, the part that looks like
            it to first order.
        hidden: parameters that are off their null; of an effect outside the library its amplitude.
    """

    course: Course
    misfit: float
    hidden: dict[str, float]


def sized(
    cache: Path,
    name: str,
    level: float,
    start: float,
    make: Callable[[float, Sequence[float]], tuple[Course, dict[str, float]]],
    cause: str | None = None,
    most: float = np.inf,
) -> Truth:
    """Return a truth of about a wanted size, from the cache or by some trials on coarse cells.

    Args:
        cache: the cache.
        name: of the truth in the cache.
        level: wanted misfit [σ].
        start: first guess of the amplitude.
        make: course and hidden values of an amplitude, on cells of some sizes.
        cause: the cause whose likeness counts, or None for all that is left.
        most: largest amplitude, which will do where it is not enough.

    Raises:
        TooSmallError: it cannot be made as large.
    """

    def sought() -> Truth:
        measure, amplitude = ruler(cache), min(start, most)
        try:
            for _ in range(TRIES):
                course, hidden = make(amplitude, ROUGHLY)
                misfit = measure.misfit(course, cause)
                grown = amplitude * float(np.clip(level / max(misfit, 1e-9), 0.3, 3.0))
                if abs(misfit / level - 1) < CLOSE or min(amplitude, grown) >= most:
                    break
                amplitude = min(grown, most)
            if misfit < (1 - CLOSE) * level and amplitude < most:
                raise TooSmallError(f"the effect of {hidden} is {misfit:.1f} σ")
            course, hidden = make(amplitude, OF_EFFECTS)
        except (SolverError, InputError) as error:
            raise TooSmallError(str(error)) from None
        return Truth(course, measure.misfit(course, cause), hidden)

    return kept(cache / f"{name}_{level:g}.pickle", sought)


def truth_of_cause(
    cache: Path, cause: Cause, direction: FloatArray, level: float,
    companions: Mapping[str, float], most: float,
) -> Truth:  # fmt: skip
    """Return a cause of the library, along a direction in prior scales.

    Where `most` prior scales are not enough it is as large as it may be.
    """
    measure = ruler(cache)

    def make(size: float, cells: Sequence[float]) -> tuple[Course, dict[str, float]]:
        hidden = measure.values(cause, direction, size) | dict(companions)
        return pulled(hidden, sizes=cells), hidden

    start = level / max(measure.length(cause, direction), 1e-9)
    text = json.dumps([direction.tolist(), dict(companions)])
    name = f"{cause.name}_{hashlib.sha256(text.encode()).hexdigest()[:8]}"
    most = min(most, measure.largest(cause, direction))
    return sized(cache, name, level, start, make, cause.name, most)


def truth_outside(cache: Path, effect: str, level: float) -> Truth:
    """Return an effect that the library does not know."""
    return sized(
        cache,
        effect,
        level,
        level * PER_SIGMA[effect],
        lambda a, cells: (outside(effect, a, cells), {"amplitude": a}),
        most=LARGEST.get(effect, np.inf),
    )


def shown(course: Course, objective: Objective) -> FloatArray:
    """Return what the images of a course show to happen at the pixels [µm], shape (T, n_pix, 3)."""
    face, xy = Face(course.face), objective.data.image.images.xy
    motion = np.array([NodalMotion(face, nodal)(*xy.T)[0] for nodal in course.motion])
    if objective.model.pattern is not None:
        motion[..., 2] += course.values["fixed_pattern"] * objective.model.pattern
    return motion

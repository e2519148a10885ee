"""Where, when and in which signal a fit misses the data: excess misfit by place and by phase.

In each place of the face a motion that no model describes, constant and linear in X and Y for each
of u, v, w, is let go with the stretch of the face in a phase of the test, fitted parameters and
what the simulation itself leaves wrong projected out. Of the loads it is an offset and a slope over
that stretch. What such a freedom takes away beyond what it takes from noise is the misfit there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.statistics.goodness_of_fit import FAMILY_LEVEL
from driver.diagnosis.statistics.score_test import beside, score_together
from driver.diagnosis.statistics.screening import own_error_shapes
from driver.experiment.history import History, phase_of_images
from driver.identification.objective import Evaluation, Objective
from meshes.arrays import BoolArray, FloatArray
from meshes.prism import PrismGeometry
from meshes.prism_mesh import PrismMesh
from meshes.surface_grains import grains_at, segments_between_grains

WHOLE, LOADS = "the whole test", "the loads"
_BAND = 0.25  # of the width: what is near the grain boundary, an end or a long edge
_FEWEST_PIXELS, _FEWEST_IMAGES = 30, 3
_STANDS = 1e-3  # of the range of the stage: less is no motion


@dataclass(frozen=True)
class Excess:
    """What is beyond noise in one place (or the loads) and one phase.

    Attributes:
        place: of the face, or `LOADS`.
        phase: of the test, or `WHOLE`.
        misfit: square root of what is beyond the expectation of noise [σ].
        p: probability of as much under noise, for the family of all places and phases.
    """

    place: str
    phase: str
    misfit: float
    p: float

    @property
    def seen(self) -> bool:
        """Whether it is no noise."""
        return self.p < FAMILY_LEVEL


@dataclass(frozen=True)
class ResidualLocalisation:
    """Where and when fits miss the data.

    Attributes:
        before: of the identified model.
        after: of the extended one, empty where nothing was added.
    """

    before: tuple[Excess, ...]
    after: tuple[Excess, ...]


def places_on(
    geometry: PrismGeometry, xy: FloatArray, mesh: PrismMesh | None = None
) -> dict[str, BoolArray]:
    """Which pixels lie in each place of the face; places overlap, and small ones are left out.

    Args:
        geometry: the prism.
        xy: X, Y of the pixels [µm], shape (n_pix, 2).
        mesh: of several grains that no planes part, or None.
    """
    x, y = xy.T
    band, edge = _BAND * geometry.width, 0.5 * geometry.width
    places: dict[str, BoolArray] = {}
    if not geometry.boundaries:
        places["the face"] = np.ones(len(xy), dtype=bool)
    on_face = np.column_stack([xy, np.zeros(len(xy))])
    # Distance across each trace, as it is seen on the face.
    off = [
        plane.distance(on_face) / max(float(np.hypot(*plane.unit_normal[:2])), 1e-9)
        for plane in geometry.boundaries
    ]
    for grain in range(geometry.n_grains if off else 0):
        inside = np.ones(len(xy), dtype=bool)
        if grain:
            inside &= off[grain - 1] > band
        if grain < len(off):
            inside &= off[grain] < -band
        places[f"grain {grain + 1}"] = inside
    for number, across in enumerate(off, start=1):
        name = "the grain boundary" if len(off) == 1 else f"grain boundary {number}"
        places[name] = np.abs(across) <= band
    if mesh is not None:
        places = _of_mesh(mesh, xy, band)
    places["the end S−"], places["the end S+"] = y < band, y > geometry.length - band
    places["the long edges"] = np.abs(x) > edge - 0.5 * band
    return {name: there for name, there in places.items() if there.sum() >= _FEWEST_PIXELS}


def _of_mesh(mesh: PrismMesh, xy: FloatArray, band: float) -> dict[str, BoolArray]:
    """Grains off their boundaries, and a band along all of these."""
    start, end = np.swapaxes(segments_between_grains(mesh), 0, 1)
    along = end - start
    share = np.sum((xy[:, None] - start) * along, axis=2) / np.sum(along**2, axis=1)
    nearest = start + np.clip(share, 0.0, 1.0)[:, :, None] * along
    off = np.linalg.norm(xy[:, None] - nearest, axis=2).min(axis=1)
    grain = grains_at(mesh, xy)
    places = {f"grain {k + 1}": (grain == k) & (off > band) for k in range(mesh.n_grains)}
    return places | {"the grain boundaries": off <= band}


def phases_of(history: History) -> dict[str, BoolArray]:
    """Which images belong to each phase of the test, shapes (T,); phases of few are left out."""
    number = phase_of_images(history)
    stage = history.stage[history.image_row]
    stands = np.zeros(len(stage), dtype=bool)
    stands[1:] = np.abs(np.diff(stage)) < _STANDS * np.ptp(history.stage)
    phases = {
        "the first loading": (number == 0) & ~stands,
        "unloading": (number % 2 == 1) & ~stands,
        "loading again": (number % 2 == 0) & (number > 0) & ~stands,
        "holds": stands,
    }
    return {name: then for name, then in phases.items() if then.sum() >= _FEWEST_IMAGES}


def excess(
    fitted: Evaluation,
    objective: Objective,
    places: Mapping[str, BoolArray],
    phases: Mapping[str, BoolArray],
    variance: float,
) -> tuple[Excess, ...]:
    """Return the excess in every place and the loads, in every phase and the whole test.

    Args:
        fitted: a fit.
        objective: its objective.
        places: which pixels lie in each, shapes (n_pix,).
        phases: which images belong to each, shapes (T_all,).
        variance: of whitened numbers along model errors, 1 for noise alone.
    """
    data = objective.data
    at = beside(fitted, own_error_shapes(objective))
    xy = data.image.images.xy
    across = fitted.motion[..., 1] @ (xy[:, 1] - xy[:, 1].mean())
    stretch = across / max(float(np.abs(across).max()), 1e-12)
    courses = {phase: then.astype(float) for phase, then in phases.items()}
    courses[WHOLE] = np.ones(len(stretch))
    rows: dict[tuple[str, str], FloatArray] = {}
    for place, there in places.items():
        shapes = _linear(xy, there)
        for phase, course in courses.items():
            rows[place, phase] = data.shape_changes(shapes, course * stretch)
    if data.with_loads:
        for phase, course in courses.items():
            read = data.load_index
            lines = np.stack([np.ones(read.size), stretch[read]])
            rows[LOADS, phase] = data.load_changes(course[read] * lines)
    excesses = []
    for (place, phase), these in rows.items():
        scored = score_together([these], at, data.load_degrees, variance)
        misfit = float(np.sqrt(max(scored.statistic - scored.degrees, 0.0)))
        excesses.append(Excess(place, phase, misfit, min(1.0, scored.p * len(rows))))
    return tuple(excesses)


def residual_localisation(
    found: Diagnosis, geometry: PrismGeometry, history: History, mesh: PrismMesh | None = None
) -> ResidualLocalisation:
    """Where and when the identified and the extended model miss the data.

    Args:
        found: the diagnosis.
        geometry: the prism as drawn.
        history: the loading history.
        mesh: of several grains that no planes part, or None.
    """
    places = places_on(geometry, found.objective.data.image.images.xy, mesh)
    phases = phases_of(history)
    first, last = found.rounds[0].widened ** 2, found.rounds[-1].widened ** 2
    objective = found.baseline_objective
    before = excess(found.baseline.inside(objective), objective, places, phases, first)
    if not found.causes:
        return ResidualLocalisation(before, ())
    objective = found.objective
    after = excess(found.extended.inside(objective), objective, places, phases, last)
    return ResidualLocalisation(before, after)


def as_text(where: ResidualLocalisation) -> str:
    """Return the same in words."""
    text = _most_of("The identified model", where.before)
    if not where.after or not any(part.seen for part in where.before):
        return text
    if not any(part.seen for part in where.after):
        return f"{text} The extended model leaves none of it."
    return f"{text} {_most_of('The extended model', where.after)}"


def still_missed(where: ResidualLocalisation) -> str:
    """Say what the last of both models misses; nothing where no place or phase shows any."""
    last = where.after or where.before
    if not any(part.seen for part in last):
        return ""
    return _most_of("the extended model" if where.after else "the identified model", last)


def _most_of(who: str, every: Sequence[Excess]) -> str:
    clauses, silent = [], []
    for signal in ("the images", LOADS):
        of = [part for part in every if (part.place == LOADS) == (signal == LOADS)]
        if seen := [part for part in of if part.seen]:
            clauses.append(_where_and_when(signal, seen))
        elif of:
            silent.append(signal)
    if not clauses:
        return (
            f"{who} leaves no more than noise at any single place of the face, in any single phase "
            "of the test and in the loads."
        )
    rest = f"; {silent[0]} show nothing beyond noise" if silent else ""
    return f"{who} misses what {', and '.join(clauses)}{rest}."


def _where_and_when(signal: str, seen: Sequence[Excess]) -> str:
    worst = max(seen, key=lambda one: one.misfit)
    where = "" if worst.place == LOADS else f" at {worst.place}"
    when = "over the whole test" if worst.phase == WHOLE else f"in {worst.phase}"
    text = f"{signal} show most{where} {when} ({worst.misfit:.1f} σ beyond noise"
    phases = [one for one in seen if one.place == worst.place and one.phase != WHOLE]
    if worst.phase == WHOLE and phases:
        then = max(phases, key=lambda one: one.misfit)
        text += f", {then.misfit:.1f} σ in {then.phase}"
    return f"{text})"


def _linear(xy: FloatArray, there: BoolArray) -> FloatArray:
    """Motions constant and linear in a place, of each component, shape (9, n_pix, 3)."""
    inside = xy[there]
    middle, reach = inside.mean(axis=0), np.maximum(np.ptp(inside, axis=0), 1e-9)
    linear = np.column_stack([np.ones(len(xy)), (xy - middle) / reach]) * there[:, None]
    return np.asarray(np.einsum("pm,cd->mcpd", linear, np.eye(3)).reshape(9, len(xy), 3))

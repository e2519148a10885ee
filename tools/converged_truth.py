"""The test of the short specimen: converged, and beside it what an effect changes.

Without an effect it is the mean of two kinds of small cells, each with its cure of locking and
extrapolated to cells of no size, in a third of the time steps (`mesh_reference`). An effect adds
what it changes on hexahedra of two sizes, extrapolated alike (benchmarks/diagnosis.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from driver.case.model import Case
from driver.case.specimen import SIZES
from driver.experiment.history import History
from driver.forward.build import adapter_of, build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.virtual.truth import Course, seen_course, true_model
from meshes.prism import CellKind, generate
from solver_adapters.interface import Simulation
from tools import mesh_reference
from tools.mesh_reference import Reference, extrapolated, on_face
from tools.short_specimen import CYCLES, small_case, true_knots
from tools.short_specimen import true_case as as_it_is
from tools.stage_histories import steady_history

Change = Callable[[Simulation, History], Simulation]

MOVE, SECONDS = 5.0, 15.0  # stage travel [µm] and time from one image to the next
REFERENCE = "short"
SMALLEST: tuple[tuple[CellKind, tuple[float, float]], ...] = (
    ("hex20", (0.5, 0.4)),
    ("tet10", (0.5, 0.35)),
)
"""Cells of the reference and their two sizes [µm]."""
OF_EFFECTS = (0.667, 0.5)
"""Sizes of the hexahedra that tell what an effect changes [µm]."""
DENSEST = 3
"""Images of the reference for each image of the test."""


def known_case() -> Case:
    """Return what the user knows and believes of the specimen, on hexahedra."""
    case = small_case()
    mesh = {"cells": "hex20", "mesh_size_um": 2.0, "fine_mesh_size_um": 0.667}
    return case.model_copy(update={"specimen": case.specimen.model_copy(update=mesh)})


def true_case() -> Case:
    """Return the specimen as it is, another law and other apex amplitudes, for the change alone."""
    truth = as_it_is(small_case())
    mesh = {"cells": "hex20"} | dict(zip(SIZES, OF_EFFECTS, strict=True))
    steps = {"steps_per_interval": 1, "mean_dilatation": True}
    return truth.model_copy(
        update={
            "specimen": truth.specimen.model_copy(update=mesh),
            "solver": truth.solver.model_copy(update=steps),
        }
    )


def stage_history(dense: int = 1) -> History:
    """Make a stage move on steadily.

    Args:
        dense: by how many times there are more images, in steps as much shorter.
    """
    cycles = [(dense * up, dense * down) for up, down in CYCLES]
    return steady_history(cycles, MOVE / dense, SECONDS / dense, SECONDS)


def pulled(
    hidden: Mapping[str, float],
    truth: Case | None = None,
    change: Change | None = None,
    dense: int = 1,
    sizes: Sequence[float] = OF_EFFECTS,
) -> Course:
    """Return the test, converged but for what the mesh leaves wrong of an effect.

    Args:
        hidden: true values of parameters of the general model that are not at their null.
        truth: the specimen, where it is not that of `true_case`; its face is the same.
        change: what happens besides that no parameter of the general model says.
        dense: as of the history; it divides `DENSEST`.
        sizes: of the cells that tell what an effect changes [µm], larger ones first: of two it is
            extrapolated, of one it is taken as it is.

    Raises:
        InputError: a parameter is unknown or out of its bounds.
        SolverError: the simulation could not be finished, or a geometric parameter turns a
            cell inside out.
    """
    converged, images = _converged(), slice(None, None, DENSEST // dense)
    motion, load = converged.motion.mean(axis=0)[images], converged.load.mean(axis=0)[images]
    if not hidden and truth is None and change is None:
        return replace(_seen(dense), face=converged.face, motion=motion, load=load)
    points, found = converged.face.points, []
    for size in sizes:
        course, bare = _on(truth or true_case(), size, hidden, change, dense), _bare(size, dense)
        moved = on_face(course.face, course.motion, points)
        moved -= on_face(bare.face, bare.motion[0], points)
        found.append((moved, course.load - bare.load[0]))
    moved, more = found[-1]
    if len(found) > 1:
        (coarse_moved, coarse_more), ratio = found[0], sizes[1] / sizes[0]
        moved = extrapolated(coarse_moved, moved, ratio)
        more = extrapolated(coarse_more, more, ratio)
    return replace(course, face=converged.face, motion=motion + moved, load=load + more)


def _on(
    truth: Case, size: float, hidden: Mapping[str, float], change: Change | None, dense: int
) -> Course:
    """Return the test of a specimen on cells of one size [µm]."""
    return simulated(truth.with_values_at({f"specimen.{SIZES[0]}": size}), hidden, change, dense)


def simulated(
    truth: Case, hidden: Mapping[str, float], change: Change | None = None, dense: int = 1
) -> Course:
    """Simulate the test of a specimen on its own mesh, errors as of `pulled`.

    Args:
        truth: the specimen.
        hidden: true values of parameters of the general model that are not at their null.
        change: what happens besides that no parameter of the general model says.
        dense: as of the history.
    """
    history = stage_history(dense)
    adapter = adapter_of(truth)
    model, values = true_model(truth, history, adapter, {**true_knots(history), **hidden})
    simulation = model.simulation(values)
    if change is not None:
        simulation = change(simulation, history)
    return seen_course(model, simulation, history, values)


def make() -> None:
    """Simulate the reference anew, and what effects add to: a quarter of an hour of one core."""
    mesh_reference.write(_reference(), REFERENCE)
    for size in OF_EFFECTS:
        mesh_reference.write(_without_effect(size, 1), _name(size))


def _reference() -> Reference:
    truth, history = true_case(), stage_history(DENSEST)
    adapter = adapter_of(truth)
    _, values = true_model(truth, history, adapter, true_knots(history))

    def model(kind: CellKind, size: float) -> ForwardModel:
        mesh = generate(geometry_of(truth), size, kind)
        return build_model(truth, mesh, history, np.zeros((0, 2)), adapter, 1)

    pairs = [(model(kind, large), model(kind, small)) for kind, (large, small) in SMALLEST]
    return mesh_reference.made(pairs, values)


@cache
def _converged() -> Reference:
    return mesh_reference.read(REFERENCE)


def _bare(size: float, dense: int) -> Reference:
    """Return what an effect adds to, on cells of one size."""
    stored = dense == 1 and size in OF_EFFECTS
    return mesh_reference.read(_name(size)) if stored else _without_effect(size, dense)


def _name(size: float) -> str:
    return f"{REFERENCE}_{size:g}"


@cache
def _without_effect(size: float, dense: int) -> Reference:
    course = _on(true_case(), size, {}, None, dense)
    return Reference(course.face, course.motion[None], course.load[None], 0)


@cache
def _seen(dense: int) -> Course:
    """Return the test on few cells, of which nothing but what is known of it counts."""
    few = {f"specimen.{SIZES[0]}": known_case().specimen.mesh_size}
    return simulated(true_case().with_values_at(few), {}, None, dense)

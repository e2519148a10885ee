"""The test of the short specimen: converged, and beside it what an effect changes.

Without an effect it is the mean of two kinds of small cells, each with its cure of locking, in a
third of the time steps (`mesh_reference`). An effect adds what it changes on hexahedra of two
thirds of the finer size of the case, so that their error counts in that change alone: an eighth of
it for a contrast of the grains (benchmarks/diagnosis.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from driver.case.model import Case
from driver.experiment.history import History
from driver.forward.build import adapter_of, build_model, geometry_of
from driver.virtual.truth import Course, history_of_rows, seen_course, true_model
from meshes.prism import CellKind, generate
from solver_adapters.interface import Simulation
from tools import mesh_reference
from tools.mesh_reference import Reference, on_face
from tools.short_specimen import CYCLES, small_case, true_knots
from tools.short_specimen import true_case as as_it_is

Change = Callable[[Simulation, History], Simulation]

MOVE, SECONDS = 5.0, 15.0  # stage travel [µm] and time from one image to the next
REFERENCE = "short"
SMALLEST: tuple[tuple[CellKind, float], ...] = (("hex20", 0.5), ("tet10", 0.5))
"""Cells of the reference and their size [µm]."""
DENSEST = 3
"""Images of the reference for each image of the test."""


def known_case() -> Case:
    """Return what the user knows and believes of the specimen, on hexahedra."""
    case = small_case()
    mesh = {"cells": "hex20", "mesh_size_um": 2.0, "fine_mesh_size_um": 1.0}
    return case.model_copy(update={"specimen": case.specimen.model_copy(update=mesh)})


def true_case() -> Case:
    """Return the specimen as it is, another law and other apex amplitudes, for the change alone."""
    truth = as_it_is(small_case())
    mesh = {"cells": "hex20", "mesh_size_um": 0.667, "fine_mesh_size_um": 0.4}
    steps = {"steps_per_interval": 1, "mean_dilatation": True}
    return truth.model_copy(
        update={
            "specimen": truth.specimen.model_copy(update=mesh),
            "solver": truth.solver.model_copy(update=steps),
        }
    )


def stage_history(dense: int = 1) -> History:
    """Make a stage move on slowly from image to image, and hold at each peak before its image.

    A hold before every image, as a microscope that scans needs it, would double the intervals
    that each simulation has to go through.

    Args:
        dense: by how many times there are more images, in steps as much shorter.
    """
    time, stage, rows = 0.0, 0.0, [(0.0, 0.0, True)]
    for up, down in CYCLES:
        for k, step in enumerate(dense * up * [MOVE] + dense * down * [-MOVE]):
            time, stage = time + SECONDS / dense, stage + step / dense
            peak = k == dense * up - 1
            rows.append((time, stage, not peak))
            if peak:
                time += SECONDS
                rows.append((time, stage, True))
    return history_of_rows(rows)


def pulled(
    hidden: Mapping[str, float],
    truth: Case | None = None,
    change: Change | None = None,
    dense: int = 1,
) -> Course:
    """Return the test, converged but for what the mesh leaves wrong of an effect.

    Args:
        hidden: true values of parameters of the general model that are not at their null.
        truth: the specimen, where it is not that of `true_case`; its face is the same.
        change: what happens besides that no parameter of the general model says.
        dense: as of the history; it divides `DENSEST`.

    Raises:
        InputError: a parameter is unknown or out of its bounds.
        SolverError: the simulation could not be finished, or a geometric parameter turns a
            cell inside out.
    """
    converged, bare = _converged(), _bare(dense)
    as_usual = not hidden and truth is None and change is None
    course = bare if as_usual else simulated(truth or true_case(), hidden, change, dense)
    points, images = converged.face.points, slice(None, None, DENSEST // dense)
    moved = on_face(course.face, course.motion, points) - on_face(bare.face, bare.motion, points)
    return replace(
        course,
        face=converged.face,
        motion=converged.motion.mean(axis=0)[images] + moved,
        load=converged.load.mean(axis=0)[images] + course.load - bare.load,
    )


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


def reference() -> Reference:
    """Simulate the reference anew, which takes about ten minutes of one core."""
    truth, history = true_case(), stage_history(DENSEST)
    adapter = adapter_of(truth)
    _, values = true_model(truth, history, adapter, true_knots(history))
    one, other = (
        build_model(
            truth, generate(geometry_of(truth), size, kind), history, np.zeros((0, 2)), adapter, 1
        )
        for kind, size in SMALLEST
    )
    return mesh_reference.made((one, other), values)


@cache
def _converged() -> Reference:
    return mesh_reference.read(REFERENCE)


@cache
def _bare(dense: int) -> Course:
    return simulated(true_case(), {}, None, dense)

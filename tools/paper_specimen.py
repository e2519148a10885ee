"""The specimen of the paper in finite strain, its test in moves of eight stops.

Microscope, noise, law, apex amplitudes and the stage travel at each peak are those of
`examples/if_steel`; an unloading takes three moves. Its 320 images would take hours on cells that
are small enough to judge others.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from driver.case.model import Case, load_case
from driver.experiment.history import History
from driver.forward.build import adapter_of, build_model, geometry_of
from driver.forward.model import ForwardModel
from driver.virtual.settings import Virtual, read_virtual
from driver.virtual.truth import Course, knots, seen_course, true_model
from meshes.prism import CellKind, generate
from tools import mesh_reference
from tools.mesh_reference import Reference
from tools.stage_histories import steady_history

_FOLDER = Path(__file__).parents[1] / "examples" / "if_steel"
REFERENCE = "if_steel"
_EVERY = 8
# Stage travel [µm] and time from image to image, and at a peak before its image [s].
_MOVE, _SECONDS, _HOLD = 5.0 * _EVERY, 40.0 * _EVERY, 30.0
SMALLEST: tuple[tuple[CellKind, tuple[float, float]], ...] = (
    ("hex20", (0.5, 0.4)),
    ("tet10", (0.35, 0.27)),
)
"""Cells of the reference and their two sizes [µm]."""


def known_case() -> Case:
    """Return what the user knows and believes of the specimen, on hexahedra."""
    case = load_case(_FOLDER / "case.toml")
    mesh = {"cells": "hex20", "mesh_size_um": 2.0, "fine_mesh_size_um": 0.667}
    steps = {"steps_per_interval": 1, "mean_dilatation": True}
    return case.model_copy(
        update={
            "specimen": case.specimen.model_copy(update=mesh),
            "solver": case.solver.model_copy(update=steps),
        }
    )


def settings() -> Virtual:
    """Return microscope, test and truth, with an eighth of the images."""
    whole = read_virtual(_FOLDER / "virtual.toml")
    cycles = tuple((up // _EVERY, down // _EVERY) for up, down in whole.program.cycles)
    return whole.model_copy(update={"program": whole.program.model_copy(update={"cycles": cycles})})


def history() -> History:
    """Return the test: a stage that moves on slowly, and holds at each peak before its image."""
    return steady_history(settings().program.cycles, _MOVE, _SECONDS, _HOLD)


def true_values() -> dict[str, float]:
    """Return the true value of every parameter that is not as in the case."""
    test, case = settings(), known_case()
    return knots(history(), test.program, case.specimen.length) | test.truth


def pulled() -> Course:
    """Return the test, converged; the few cells it is simulated on tell its values and instants."""
    converged, case, test = mesh_reference.read(REFERENCE), known_case(), history()
    model, values = true_model(case, test, adapter_of(case), true_values())
    course = seen_course(model, model.simulation(values), test, values)
    return replace(
        course,
        face=converged.face,
        motion=converged.motion.mean(axis=0),
        load=converged.load.mean(axis=0),
    )


def make() -> None:
    """Simulate the reference anew."""
    mesh_reference.write(_reference(), REFERENCE)


def _model_on(kind: CellKind, size: float) -> ForwardModel:
    """Return the specimen on cells of a kind and size [µm], without a pixel on it."""
    case = known_case()
    mesh = generate(geometry_of(case), size, kind)
    return build_model(case, mesh, history(), np.zeros((0, 2)), adapter_of(case), 1)


def _reference() -> Reference:
    case = known_case()
    _, values = true_model(case, history(), adapter_of(case), true_values())
    pairs = [(_model_on(kind, a), _model_on(kind, b)) for kind, (a, b) in SMALLEST]
    return mesh_reference.made(pairs, values)

"""A truth on hexahedra beside the converged reference, half of which are other cells."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from driver.forward.build import adapter_of
from driver.virtual.truth import coarser_size, pull, seen_course, true_model
from solver_adapters.interface import Progress
from tools import mesh_reference
from tools.converged_truth import DENSEST, REFERENCE, stage_history, true_case
from tools.short_specimen import true_knots


def test_a_truth_on_hexahedra_is_extrapolated_towards_the_converged_one() -> None:
    truth = true_case().with_values_at({"specimen.mesh_size_um": 1.0})
    history = stage_history()
    assert coarser_size(truth) == 2.0
    converged = mesh_reference.read(REFERENCE).load.mean(axis=0)[::DENSEST]
    model, values = true_model(truth, history, adapter_of(truth), true_knots(history))
    plain = seen_course(model, model.simulation(values), history, values)
    told: dict[str, list[float]] = {"fine": [], "larger": []}

    def tell(which: str) -> Callable[[Progress], None]:
        return lambda progress: told[which].append(progress.time / progress.end)

    hidden = true_knots(history)
    course = pull(truth, history, hidden, False, tell("fine"), tell("larger"))
    off, before = (np.linalg.norm(load - converged) for load in (course.load, plain.load))
    assert off < 0.6 * before
    assert course.face.points.shape == plain.face.points.shape
    # On the ends, which are moved alike, nothing is extrapolated.
    ends = np.isclose(plain.face.points[:, 1] % truth.specimen.length, 0.0)
    np.testing.assert_allclose(course.motion[:, ends, 1], plain.motion[:, ends, 1], atol=1e-8)

    # Each of the two simulations tells its own progress, once to its end.
    for shares in told.values():
        assert shares == sorted(shares) and shares[-1] == 1.0


def test_a_truth_on_tetrahedra_is_as_it_is() -> None:
    assert coarser_size(true_case().with_values_at({"specimen.cells": "tet10"})) is None

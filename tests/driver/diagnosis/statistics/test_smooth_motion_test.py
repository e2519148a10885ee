from __future__ import annotations

from dataclasses import replace

import numpy as np

from driver.diagnosis.answer.result_types import Diagnosis
from driver.diagnosis.causes.causes import NUMERICS
from driver.diagnosis.statistics.smooth_motion_test import smooth_fields
from driver.dic.basis import grid_basis
from driver.identification.data import Data
from driver.identification.image_data import build_image_data
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation
from tools import closed_form
from tools.closed_form import LENGTH, PIXEL
from tools.closed_form_diagnosis import SETTINGS, diagnosis_of, identified

BENCH = closed_form.problem()
MOTION = BENCH.model.predict(BENCH.truth).motion


def resolved() -> Data:
    """The data of a correlation mesh that resolves more than the fields."""
    data = closed_form.objective(BENCH, BENCH.truth).data
    images = data.image.images
    basis = grid_basis(images.xy, images.bounds, 5 * PIXEL)
    moved = data.image.mean_motion
    image = build_image_data(images, basis, basis, moved, "translation", MOTION[:, ::200, :2])
    return replace(data, image=image)


DATA = resolved()
XY = DATA.image.images.xy


def share_outside(change: FloatArray) -> float:
    """Share of the power of a change of the motion that no smooth field has."""
    effect = DATA.change(change, np.zeros(len(change)))
    fields = smooth_fields(DATA, MOTION)
    rest = effect - np.linalg.lstsq(fields.T, effect)[0] @ fields
    return float(np.sum(rest**2) / np.sum(effect**2))


def through_a_lens(place: FloatArray) -> FloatArray:
    """Where a lens of 1 % shows what stands at a place, shape (..., 2)."""
    from_axis = place - XY.mean(axis=0) - [0.2, -0.3]
    growing = np.sum((from_axis / LENGTH) ** 2, axis=-1, keepdims=True)
    return np.asarray(0.01 * growing * from_axis)


def test_a_lens_makes_a_smooth_motion_that_grows_with_the_stretch() -> None:
    # The stage has re-centred before each image.
    moved = XY + MOTION[..., :2] - MOTION[..., :2].mean(axis=1, keepdims=True)
    change = np.zeros_like(MOTION)
    change[..., :2] = through_a_lens(moved) - through_a_lens(XY)
    assert share_outside(change) < 0.01


def test_a_step_across_the_face_is_none_of_them_nor_a_tilt_of_the_last_images() -> None:
    step = np.zeros_like(MOTION)
    step[..., 2] = np.ptp(MOTION[..., 1], axis=1, keepdims=True) * (XY[:, 1] > 0.6 * LENGTH)
    tilt = np.zeros_like(MOTION)
    tilt[-8:, :, 2] = XY[:, 0]
    assert share_outside(step) > 0.05 and share_outside(tilt) > 0.3


class Warped(closed_form.ClosedFormSolver):
    """A model that warps the face, growing with the stretch, as no cause of the library does."""

    warp = 0.0

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        x, y, _ = simulation.mesh.points[simulation.output_nodes].T
        stretch = np.ptp(motion[..., 1], axis=1)
        motion[..., 0] += self.warp * stretch[:, None] * x * np.sin(2 * np.pi * y / LENGTH)
        return motion, load


class Little(Warped):
    warp = 0.05


class Converging(closed_form.ClosedFormSolver):
    """A mesh that errs smoothly in proportion to its size, and a finer one half as large."""

    def answer(self, simulation: Simulation) -> tuple[FloatArray, FloatArray]:
        motion, load = super().answer(simulation)
        x = simulation.mesh.points[simulation.output_nodes, 0]
        stretch = np.ptp(motion[..., 1], axis=1)
        motion[..., 1] += (0.25 if self.finer else 0.5) * stretch[:, None] * x**2
        return motion, load


def diagnosed(solver: closed_form.ClosedFormSolver) -> Diagnosis:
    """The diagnosis of a test that the solver simulates as it was, but for what it gets wrong."""
    problem = replace(BENCH, model=replace(BENCH.model, adapter=solver))
    made = replace(closed_form.objective(BENCH, BENCH.truth), model=problem.model)
    return diagnosis_of(problem, identified(problem, made))


def test_what_moves_the_face_smoothly_and_is_like_no_cause_is_unexplained() -> None:
    found = diagnosed(Little())
    assert found.verdict.kind == "unexplained" and not found.verdict.names
    tests = found.rounds[-1].goodness_of_fit
    assert tests.smooth < 1e-4 and min(tests.image_slow, tests.together) > 0.01
    assert diagnosed(Warped()).verdict.kind == "nothing wrong"


def test_what_looks_like_the_error_of_the_mesh_is_no_smooth_motion() -> None:
    """The fit has half of the error of the mesh, 0.8 nm, and the correction the other half."""
    sizes = (1.2, 0.6)
    problem = replace(BENCH, model=replace(BENCH.model, adapter=Converging()))
    made = replace(closed_form.objective(BENCH, BENCH.truth), model=problem.model)
    settings = replace(SETTINGS, sizes=sizes)
    found = diagnosis_of(problem, identified(problem, made, sizes), settings)
    (step,) = found.rounds
    assert found.verdict.kind == "nothing wrong" and step.goodness_of_fit.smooth > 0.05
    # It is there, and is told as what it is.
    assert next(s.p for s in step.scores if s.cause == NUMERICS) < 1e-6

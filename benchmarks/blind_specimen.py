"""The specimen of the blind trial, and what can happen to it: truths that are converged.

Short, two cycles, twenty-one images: the least on which most causes are still told apart. Without
an effect the truth is the mean of two kinds of small cells; what an effect changes is extrapolated
to cells of no size (`tools/converged_truth.py`, benchmarks/diagnosis.md).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from driver.case.model import Case
from driver.diagnosis.causes.ebsd_flips import FLIPS, frame_turn
from driver.experiment.history import History
from driver.forward.build import adapter_of, build_model, mesh_of
from driver.virtual.truth import Course
from meshes.arrays import FloatArray
from solver_adapters.interface import Simulation
from tools.beyond_parameters import blistered, with_soft_slice
from tools.converged_truth import OF_EFFECTS, pulled, stage_history, true_case
from tools.short_specimen import CYCLES, small_case

LENGTH = 8.0
PER_SIGMA = {
    "soft_slice": 0.30, "notch": 0.065, "creep": 0.70, "lens": 0.48, "blister": 0.5,
    "slip_band": 0.5,
}  # fmt: skip
"""Effects of which the library knows nothing; each has one amplitude, so much for each σ."""
LARGEST = {"soft_slice": 8.0, "notch": 2.0}
"""Amplitudes beyond which an effect does not grow."""


ROUGHLY = (2.0, 1.0)
"""Cells that tell how large an effect is [µm], before its truth is made."""
STAGE_ERRORS = (0.667,)
"""Cells that tell what noise of the boundary changes [µm]: of a small part the error is small."""
SHARP = (0.5,)
"""Cells whose layers an effect follows [µm]: on other cells it is another one."""
FINEST = 1
"""How often the meshes may be refined; no clock says where that ends."""


def known_case(refined: int = 0) -> Case:
    """Return what the user knows and believes, with the starts of the paper.

    Args:
        refined: how often the automatic sizes were refined.
    """
    case = small_case()
    return case.model_copy(
        update={
            "specimen": case.specimen.at_level("hex20", refined),
            "diagnosis": case.diagnosis.model_copy(update={"held_out_cycle": "last", "refit": 5}),
            "execution": case.execution.model_copy(update={"processes": 1, "threads": 1}),
        }
    )


@cache
def null_values() -> dict[str, float]:
    """Every parameter of the general model at its null, the law as it truly is."""
    truth, history = true_case(), stage_history()
    mesh = mesh_of(truth, known_case().specimen.mesh_size)
    model = build_model(truth, mesh, history, np.zeros((0, 2)), adapter_of(truth), 1)
    return model.null_values()


def jittered(sigma: float, seed: int, dense: int = 1) -> Course:
    """Let the ends stop a little off, σ [µm] at each stop anew; the specimen feels every one."""
    rng = np.random.default_rng(seed)

    def change(simulation: Simulation, history: History) -> Simulation:
        off = np.zeros(simulation.times.size)
        off[history.image_row[1:]] = sigma * rng.standard_normal(history.n_images - 1)
        # The ends do not move in a hold, which begins with the row before its image.
        held = np.flatnonzero(np.diff(history.stage) == 0)
        off[held] = off[held + 1]
        return _elongated(simulation, off)

    return pulled({}, change=change, dense=dense, sizes=STAGE_ERRORS)


def flipped(flip: str) -> Course:
    """Return test of a specimen whose lattices are half a turn off those that the case states."""
    turn = frame_turn([cause for cause in FLIPS if cause.name == flip])

    def change(simulation: Simulation, history: History) -> Simulation:
        return replace(simulation, orientations=turn @ simulation.orientations)

    return pulled({}, change=change)


def outside(effect: str, amplitude: float, sizes: Sequence[float] = OF_EFFECTS) -> Course:
    """Return the test of a specimen with an effect of `PER_SIGMA`.

    Args:
        effect: its name.
        amplitude: its size.
        sizes: as of `pulled`.
    """
    shown = {"lens": _through_a_lens, "slip_band": _slipped}
    if effect == "blister":
        return blistered(pulled({}), 0.010 * amplitude)
    if effect in shown:
        return shown[effect](pulled({}), amplitude)
    changes: dict[str, Callable[[Simulation, History, float], Simulation]] = {
        "soft_slice": _with_soft_slice, "notch": _notched, "creep": _creeping,
    }  # fmt: skip

    def change(simulation: Simulation, history: History) -> Simulation:
        return changes[effect](simulation, history, amplitude)

    return pulled({}, change=change, sizes=SHARP if effect == "soft_slice" else sizes)


def _with_soft_slice(simulation: Simulation, history: History, amplitude: float) -> Simulation:
    """Let a slice of grain 2, 1.6 µm long, yield early: τ0 is e^(−0.3·amplitude) of it."""
    return with_soft_slice(simulation, float(np.exp(-0.3 * amplitude)))


def _notched(simulation: Simulation, history: History, amplitude: float) -> Simulation:
    """Let a notch across the apex line, about 2 µm wide, takes 0.3·amplitude of the depth.

    A deeper or narrower one would turn cells of this mesh inside out.
    """
    mesh = simulation.mesh
    points = mesh.points.copy()
    share = min(0.3 * amplitude, 0.6)
    points[:, 2] *= 1 - share * np.exp(-((points[:, 1] - 0.25 * LENGTH) ** 2))
    return replace(simulation, mesh=replace(mesh, points=points))


def _creeping(simulation: Simulation, history: History, amplitude: float) -> Simulation:
    """Let the ends go on apart by amplitude·2 nm for each factor e in time after a minute."""
    return _elongated(simulation, amplitude * 0.002 * np.log1p(simulation.times / 60.0))


def _elongated(simulation: Simulation, more: FloatArray) -> Simulation:
    """Return the ends further apart, by so much at each instant [µm], shape (n_times,)."""
    y = simulation.mesh.points[simulation.motion_nodes, 1]
    side = np.where(y > LENGTH / 2, 0.5, -0.5)
    motion = simulation.motion.copy()
    motion[:, :, 1] += np.outer(more, side)
    return replace(simulation, motion=motion)


def _through_a_lens(course: Course, amplitude: float) -> Course:
    """Return a radial distortion that grows with time, amplitude·2·10⁻⁴ of r³ at its end [µm⁻²]."""
    at = course.face.points - course.face.points.mean(axis=0)
    grown = np.linspace(0.0, 1.0, len(course.motion))
    motion = course.motion.copy()
    field = at * (at**2).sum(axis=1, keepdims=True)
    motion[..., :2] += amplitude * 2e-4 * grown[:, None, None] * field
    return replace(course, motion=motion)


def _slipped(course: Course, amplitude: float) -> Course:
    """Let a slip band crosses grain 1: amplitude·10 nm at the first peak, and as much after it.

    What lies beyond it slides along it, and sinks by half of that.
    """
    at = course.face.points
    along = np.array([np.sin(0.8), np.cos(0.8)])
    across = np.array([along[1], -along[0]])
    place = at.mean(axis=0) + np.array([0.0, -1.5])
    side = 0.5 * (1.0 + np.tanh((at - place) @ across / 0.3))
    grown = np.minimum(np.arange(len(course.motion)) / CYCLES[0][0], 1.0)
    jump = amplitude * 0.010 * grown[:, None] * side
    motion = course.motion.copy()
    motion[..., :2] += jump[..., None] * along
    motion[..., 2] -= 0.5 * jump
    return replace(course, motion=motion)

"""What can happen to the short specimen that no parameter of the general model says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from driver.virtual.truth import Course
from solver_adapters.interface import Simulation
from tools.converged_truth import known_case

SLICE = (0.60, 0.80)
"""Where the soft slice lies along Y, in lengths of the specimen: cells of 0.5 µm end there."""


def with_soft_slice(simulation: Simulation, ratio: float) -> Simulation:
    """Return a simulation in which a slice of grain 2 has a smaller τ0, sharply.

    It ends where cells end.

    Args:
        simulation: of two grains.
        ratio: τ0 of the slice over that of the rest.
    """
    mesh, length = simulation.mesh, known_case().specimen.length
    middle = mesh.points[mesh.cells, 1].mean(axis=1)
    inside = (mesh.grain == 1) & (middle > SLICE[0] * length) & (middle < SLICE[1] * length)
    turned = simulation.orientations
    return replace(
        simulation,
        mesh=replace(mesh, grain=np.where(inside, 2, mesh.grain)),
        orientations=np.concatenate([turned, turned[1:]]),
        material=replace(simulation.material, tau0_grains=(ratio,)),
    )


def blistered(course: Course, height: float) -> Course:
    """Return a course in which dirt grows on a spot of the face, 1 µm wide.

    Args:
        course: what happened to the specimen.
        height: of the spot at the end of the test [µm].
    """
    off = course.face.points - course.face.points.mean(axis=0) - np.array([0.5, 1.5])
    bump = np.exp(-0.5 * (off**2).sum(axis=1))
    motion = course.motion.copy()
    motion[..., 2] += height * np.linspace(0.0, 1.0, len(motion))[:, None] * bump
    return replace(course, motion=motion)

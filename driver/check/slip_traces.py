"""Slip traces: lines in which the slip planes of a grain cut the measured face."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from driver.report.slip import schmid_factors
from meshes.arrays import FloatArray
from solver_adapters.crystal import SystemTable, slip_systems, system_name

_SAME = 1e-9  # of a unit normal
_FLATTEST = 0.05  # sine of the angle between face and a plane that leaves no trace on it


@dataclass(frozen=True)
class SlipTrace:
    """The trace of a slip plane on the face.

    Attributes:
        plane: Miller indices, such as `(0 1 1)`.
        along: unit vector along the trace, X and Y; its sign means nothing.
        schmid: largest Schmid factor of the systems of that plane, for tension along Y.
    """

    plane: str
    along: tuple[float, float]
    schmid: float


def slip_traces(rotation: FloatArray, systems: SystemTable) -> list[SlipTrace]:
    """Return the traces of all slip planes, the largest Schmid factor first.

    A plane of normal n cuts the face, whose normal is Z, along n × Z. Planes that hardly lean
    against the face have no trace on it.

    Args:
        rotation: crystal → specimen, shape (3, 3).
        systems: the slip systems.
    """
    factors = schmid_factors(rotation[1], systems)
    normals = slip_systems(systems)[1][: len(systems)]
    traces: list[SlipTrace] = []
    drawn = np.zeros((0, 3))
    for system in np.argsort(-factors, kind="stable").tolist():
        normal = normals[system]
        if (np.abs(drawn @ normal) > 1.0 - _SAME).any():
            continue
        drawn = np.vstack([drawn, normal])
        x, y, _ = rotation @ normal
        leaning = float(np.hypot(x, y))
        if leaning > _FLATTEST:
            plane = system_name(systems, system).split(" [")[0]
            along = float(y / leaning), float(-x / leaning)
            traces.append(SlipTrace(plane, along, float(factors[system])))
    return traces

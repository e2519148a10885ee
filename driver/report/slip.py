"""Slip systems of each grain: Schmid factors, how much each has slipped, and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from driver.common.formatting import number, percent
from driver.experiment.orientations import grain_orientations
from driver.identification.slip_activity import SlipActivity
from driver.report.findings import Findings
from meshes.arrays import FloatArray
from solver_adapters.crystal import SystemTable, schmid_tensors, system_name

SHOWN = 5
"""Systems of a grain that are shown one by one."""


@dataclass(frozen=True, eq=False)
class GrainSlip:
    """The slip systems of a grain.

    Attributes:
        name: of the grain.
        systems: the n slip systems.
        axis: loading axis in crystal axes, shape (3,).
        schmid: Schmid factor of each system, without sign, shape (n,).
        accumulated: slip of each system at some images [1], shape (n_images, n), or None.
    """

    name: str
    systems: SystemTable
    axis: FloatArray
    schmid: FloatArray
    accumulated: FloatArray | None

    @property
    def order(self) -> list[int]:
        """The systems, the one that has slipped most first; without slips by Schmid factor."""
        by = self.schmid if self.accumulated is None else self.accumulated[-1]
        return [int(k) for k in np.lexsort((-self.schmid, -by))]


def schmid_factors(axis: FloatArray, systems: SystemTable) -> FloatArray:
    """Schmid factor of each of n systems without its sign, shape (n,).

    Args:
        axis: loading axis in crystal axes, a unit vector, shape (3,).
        systems: the slip systems.
    """
    tensors = schmid_tensors(systems)[: len(systems)]
    return np.asarray(np.abs(np.einsum("i,sij,j->s", axis, tensors, axis)))


def grain_slips(findings: Findings) -> list[GrainSlip]:
    """Return the slip systems of each grain, its orientation as the case has it."""
    slip, grains = findings.slip, []
    systems = findings.case.material.to_material().slip_systems
    for index, found in enumerate(grain_orientations(findings.case)):
        axis = np.asarray(found.rotation[1])
        accumulated = None if slip is None else slip.of_grains[:, index, : len(systems)]
        name = findings.case.grains[index].name
        factors = schmid_factors(axis, systems)
        grains.append(GrainSlip(name, systems, axis, factors, accumulated))
    return grains


def slip_section(findings: Findings) -> dict[str, Any]:
    """Tables and texts of the section on slip, by name."""
    grains = grain_slips(findings)
    return {
        "shown": SHOWN,
        "known": findings.slip is not None,
        "grains": [
            {
                "name": grain.name,
                "axis": " ".join(f"{part:+.2f}".replace("-", "−") for part in grain.axis),
                "rows": _rows(grain),
            }
            for grain in grains
        ],
        "activity_alternative": _activity_told(grains, findings.slip),
        "poles_alternative": "Standard triangle 001, 011, 111 with the largest Schmid factor as "
        "contours and the loading axis of "
        + "; ".join(f"{g.name}, largest Schmid factor {g.schmid.max():.2f}" for g in grains),
    }


def _rows(grain: GrainSlip) -> list[dict[str, str]]:
    end = None if grain.accumulated is None else grain.accumulated[-1]
    rank = {system: place for place, system in enumerate(np.argsort(-grain.schmid), start=1)}
    rows = []
    for system in grain.order[:SHOWN]:
        row = {
            "system": system_name(grain.systems, system),
            "schmid": f"{grain.schmid[system]:.3f}",
            "rank": f"{rank[system]} of {len(grain.systems)}",
        }
        if end is not None:
            total = float(end.sum())
            share = percent(float(end[system]) / total) if total else "–"
            row |= {"slip": f"{number(100.0 * float(end[system]))} %", "share": share}
        rows.append(row)
    return rows


def _activity_told(grains: list[GrainSlip], slip: SlipActivity | None) -> str:
    if slip is None:
        return ""
    parts = []
    for grain in grains:
        assert grain.accumulated is not None
        first = grain.order[0]
        parts.append(
            f"{grain.name}: {system_name(grain.systems, first)} most, "
            f"{number(100.0 * float(grain.accumulated[-1, first]))} %"
        )
    return f"Accumulated slip of the systems of each grain over the images. {'; '.join(parts)}"

"""Slip systems of each grain: Schmid factors, how much each has slipped, and in words."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from driver.common.formatting import number, percent, with_sigma
from driver.experiment.orientations import grain_orientations
from driver.identification.measured_slip import MeasuredSlip
from driver.identification.slip_activity import SlipActivity
from driver.report.findings import Findings
from meshes.arrays import FloatArray
from solver_adapters.crystal import SystemTable, schmid_tensors, system_name

SHOWN = 5
"""Systems of a grain that are shown one by one, beside those that were measured to slip."""


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


def measured_rows(grain: GrainSlip, index: int, slip: MeasuredSlip) -> list[int]:
    """Return the systems of a grain to show: those that slip most, and those measured to slip.

    Args:
        grain: the grain.
        index: its number, from 0.
        slip: what was measured.
    """
    shown = grain.order[:SHOWN]
    by_size = np.argsort(-np.abs(slip.slip[index]), kind="stable")
    return shown + [int(k) for k in by_size if abs(slip.slip[index, k]) > 0.0 and k not in shown]


def measured_told(index: int, slip: MeasuredSlip) -> str:
    """Return a sentence on the slips of a grain that the images tell.

    Args:
        index: number of the grain, from 0.
        slip: what was measured.
    """
    if not np.isfinite(slip.total[index]).all():
        return "No slip is measured: the images do not decide the strain of this grain."
    total, sigma, floor = (100.0 * slip.total[index]).tolist()
    strains = ", ".join(
        f"{name} = ({with_sigma(100.0 * value, 100.0 * deviation)}) %"
        for name, value, deviation in zip(
            ("ε_XX", "ε_YY", "2 ε_XY"),
            slip.strain[index].tolist(),
            slip.strain_sigma[index].tolist(),
            strict=True,
        )
    )
    noise = "which may be noise alone" if total <= floor else "more than noise alone makes"
    return (
        f"Measured at image {slip.image}: the slips add up to ({with_sigma(total, sigma)}) %, "
        f"{noise} ({number(floor, 2)} % at most, in 95 of 100 measurements); mean strain on the "
        f"face {strains}, {number(100.0 * float(slip.elastic[index, 1]), 2)} % of ε_YY elastic."
    )


def slip_section(findings: Findings) -> dict[str, Any]:
    """Tables and texts of the section on slip, by name."""
    grains, measured = grain_slips(findings), findings.measured_slip
    return {
        "shown": SHOWN,
        "known": findings.slip is not None,
        "measured": measured is not None,
        "grains": [
            {
                "name": grain.name,
                "axis": " ".join(f"{part:+.2f}".replace("-", "−") for part in grain.axis),
                "rows": _rows(grain, index, measured),
                "told": "" if measured is None else measured_told(index, measured),
            }
            for index, grain in enumerate(grains)
        ],
        "activity_alternative": _activity_told(grains, findings.slip),
        "poles_alternative": "Standard triangle 001, 011, 111 with the largest Schmid factor as "
        "contours and the loading axis of "
        + "; ".join(f"{g.name}, largest Schmid factor {g.schmid.max():.2f}" for g in grains),
    }


def _rows(grain: GrainSlip, index: int, measured: MeasuredSlip | None) -> list[dict[str, str]]:
    end = None if grain.accumulated is None else grain.accumulated[-1]
    rank = {system: place for place, system in enumerate(np.argsort(-grain.schmid), start=1)}
    rows = []
    shown = grain.order[:SHOWN] if measured is None else measured_rows(grain, index, measured)
    for system in shown:
        row = {
            "system": system_name(grain.systems, system),
            "schmid": f"{grain.schmid[system]:.3f}",
            "rank": f"{rank[system]} of {len(grain.systems)}",
        }
        if end is not None:
            total = float(end.sum())
            share = percent(float(end[system]) / total) if total else "–"
            row |= {"slip": f"{number(100.0 * float(end[system]))} %", "share": share}
        if measured is not None:
            row |= _measured_cells(system, index, measured)
        rows.append(row)
    return rows


def _measured_cells(system: int, index: int, measured: MeasuredSlip) -> dict[str, str]:
    slip, sigma, growth = (
        100.0 * float(values[index, system])
        for values in (np.abs(measured.slip), measured.sigma, measured.without)
    )
    if not np.isfinite(slip):
        return {"measured": "–", "without": "–"}
    without = "no other" if np.isinf(growth) else f"+{number(max(growth, 0.0), 2)} %"
    return {
        "measured": f"{with_sigma(slip, sigma)} %",
        "without": without if slip > 0.0 else "–",
    }


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

"""Agreement of CalculiX, run here, with the bundled solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from meshes.arrays import FloatArray
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from tools import calculix_prism
from tools.agreement import Agreement, force_error, motion_error

FIRST_LOADING = 10.0  # s, of the prism of CalculiX
GOALS = {
    "calculix force": 0.5, "calculix face": 1.0, "element": 1e-4, "force": 0.1, "face": 0.2,
    "job": 5e-7,
}  # fmt: skip
"""Largest differences: of forces in percent, of faces in nm."""


def run_calculix(end: float, step: float) -> Iterator[Agreement]:
    """CalculiX through its adapter at steps of one length [s], up to an instant [s]."""
    reference = calculix_prism.read_reference()
    corners = [corner for corner in calculix_prism.CORNERS if corner < end]
    times = np.unique(np.round(np.append(np.arange(0.0, end + step / 2, step), corners), 9))
    asked = replace(
        calculix_prism.simulation(reference.mesh, times, "backward_euler"),
        output_nodes=reference.front,
    )
    response = CalculixAdapter().solve(asked)
    own = BundledAdapter().solve(replace(asked, steps=response.ends))
    pair = f"CalculiX (run here), the same to {end:g} s, {response.steps} steps"
    yield from calculix_forces(pair, times[1:], own.force[1:], response.force[1:])
    face = motion_error(own.displacement, response.displacement)
    yield Agreement(pair, "face [nm]", face, GOALS["calculix face"])
    # The limit is known every 0.1 s.
    rows = np.flatnonzero(np.isin(times.round(6), reference.fine_times.round(6)))
    exact = np.interp(times[rows], reference.fine_times, reference.fine_force)
    pair = f"limit of small steps, the same to {end:g} s at {step:g} s a step"
    yield Agreement(pair, "CalculiX: force [% of peak]", force_error(response.force[rows], exact))
    yield Agreement(
        pair, "bundled backward Euler: force [% of peak]", force_error(own.force[rows], exact)
    )
    default = replace(asked, integration="exponential", output_nodes=np.arange(0))
    yield Agreement(
        pair,
        "bundled exponential: force [% of peak]",
        force_error(BundledAdapter().solve(default).force[rows], exact),
    )


def calculix_forces(
    pair: str, times: FloatArray, own: FloatArray, expected: FloatArray
) -> Iterator[Agreement]:
    """Agreement of forces in the first loading and over all instants.

    Args:
        pair: what is compared.
        times: instants [s], shape (n,).
        own: forces of the bundled solver [µN], shape (n,).
        expected: those of CalculiX [µN], shape (n,).
    """
    first = times <= FIRST_LOADING
    peak = abs(expected).max()
    goal = GOALS["calculix force"]
    differences = 100 * abs(own - expected) / peak
    yield Agreement(
        pair, "force in first loading [% of peak]", float(differences[first].max()), goal
    )
    if not first.all():
        yield Agreement(pair, "force after it [% of peak]", float(differences[~first].max()))

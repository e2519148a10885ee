"""The whole solver against CalculiX 2.20 and an independent point solution (tests/data/solver)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Response
from tools.boxes import uniaxial
from tools.calculix_prism import (
    MATERIAL,
    ORIENTATIONS,
    Reference,
    read_reference,
    simulation,
)

DATA = Path(__file__).parents[2] / "data" / "solver"


@pytest.fixture(scope="module")
def reference() -> Reference:
    return read_reference()


@pytest.fixture(scope="module")
def same_steps(reference: Reference) -> Response:
    """The prism of CalculiX at its own 90 steps; the first row is the start."""
    times = np.append(0.0, reference.times)
    return BundledAdapter().solve(simulation(reference.mesh, times, "backward_euler"))


def test_the_force_at_calculix_steps_is_its_force(
    reference: Reference, same_steps: Response
) -> None:
    """CalculiX stops its iteration at residuals of half a percent: hence the last 0.1 %."""
    assert same_steps.steps == len(reference.times)
    difference = abs(same_steps.force[1:] - reference.force)
    # In the first increments it had iterated further than that.
    assert difference[reference.times < 3.5].max() < 1e-4 * abs(reference.force).max()
    assert difference.max() < 1e-3 * abs(reference.force).max()


def test_a_free_face_moves_as_in_calculix_within_a_nanometre(
    reference: Reference, same_steps: Response
) -> None:
    rows = 1 + np.searchsorted(reference.times, reference.instants - 1e-6)
    found = same_steps.displacement[rows][:, reference.front]
    difference = abs(found - reference.displacement)
    assert difference[reference.instants < 3.5].max() < 5e-5
    assert difference.max() < 1e-3


def test_the_force_before_the_first_reversal_is_that_of_small_steps_within_half_a_percent(
    reference: Reference,
) -> None:
    """Reference: own solution, `python -m tools.calculix_prism`; its own error is 1e-4."""
    times = np.concatenate([np.arange(0.0, 4.0, 0.1), np.arange(4.0, 10.1, 0.5)])
    force = BundledAdapter().solve(simulation(reference.mesh, times, "exponential")).force
    expected = np.interp(times, reference.fine_times, reference.fine_force)
    assert abs(force - expected)[1:].max() / abs(expected).max() < 5e-3


@pytest.mark.parametrize("grain", [0, 1])
def test_a_crystal_in_uniaxial_cycles_agrees_with_an_octahedral_point_solution(grain: int) -> None:
    """An independent backward Euler solution at the same 200 steps, 0 → 1 % → −1 % → 1 %."""
    name = ("octahedral_point.npz", "octahedral_point_grain2.npz")[grain]
    with np.load(DATA / name) as data:
        times, strains, expected = np.vstack([np.zeros(3), data["table"]]).T
    asked = uniaxial(MATERIAL, ORIENTATIONS[grain], times, strains)
    response = BundledAdapter().solve(asked)
    assert response.steps == 200
    # The section is 1 µm²: µN are MPa.
    np.testing.assert_allclose(response.force, expected, rtol=0, atol=1e-6 * abs(expected).max())

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from driver.identification.least_slip import (
    growth_without,
    least_slip,
    smallest_slips,
    systems_refitted,
)
from driver.identification.measured_slip import strains_of_slip
from meshes.arrays import FloatArray
from solver_adapters.crystal import BCC, bunge_matrix
from solver_adapters.material import Material

COLUMNS = strains_of_slip(bunge_matrix(281.0, 8.0, 47.0), Material(slip_systems=BCC))
NOISE = 1e-3


def hull() -> ConvexHull:
    """All strains of slips whose sum is 1 or less: the hull of the columns and their opposites."""
    return ConvexHull(np.hstack([COLUMNS, -COLUMNS]).T)


def gauge(strain: FloatArray) -> float:
    """Smallest sum of slips by geometry: by how much the hull has to grow to hold the strain."""
    facets = hull().equations
    return float((facets[:, :-1] @ strain / -facets[:, -1]).max())


def systems_of_a_facet() -> list[int]:
    """Three systems whose strains span the strains of one facet, with their signs as ± (k + 1)."""
    corners = hull().simplices[0]
    return [int(k) + 1 if k < 24 else 23 - int(k) for k in corners]


def slips_of(signed: list[int], sizes: list[float]) -> FloatArray:
    slip = np.zeros(24)
    for system, size in zip(signed, sizes, strict=True):
        slip[abs(system) - 1] = np.sign(system) * size
    return slip


@pytest.mark.parametrize("sizes", [[0.02, 0.0, 0.0], [0.02, 0.01, 0.0], [0.02, 0.01, 0.03]])
def test_slips_of_systems_that_no_others_undercut_are_found_exactly(sizes: list[float]) -> None:
    truth = slips_of(systems_of_a_facet(), sizes)
    found = least_slip(COLUMNS, COLUMNS @ truth, 1e-20 * np.eye(3))
    assert found.slip == pytest.approx(truth, abs=1e-9)
    assert found.total == pytest.approx(sum(sizes), rel=1e-7)


def test_the_smallest_sum_is_that_of_the_convex_hull_of_the_systems() -> None:
    for strain in np.random.default_rng(3).standard_normal((20, 3)):
        slip = smallest_slips(COLUMNS, strain, 1e-9)
        assert COLUMNS @ slip == pytest.approx(strain, abs=1e-8)
        assert np.abs(slip).sum() == pytest.approx(gauge(strain), rel=1e-6)


def test_within_a_distance_it_is_that_of_a_conic_program() -> None:
    """SSLIP states the problem so: least sum under one second-order cone, here by CVXOPT."""
    from cvxopt import matrix, solvers  # Not before the solver has chosen its kernels.

    both = np.hstack([COLUMNS, -COLUMNS])
    for strain in np.random.default_rng(4).standard_normal((5, 3)):
        answer = solvers.socp(
            matrix(1.0, (48, 1)),
            Gl=matrix(-np.eye(48)), hl=matrix(0.0, (48, 1)),
            Gq=[matrix(np.vstack([np.zeros(48), -both]))],
            hq=[matrix(np.concatenate([[0.3], -strain]))],
            options={"show_progress": False},
        )  # fmt: skip
        slip = smallest_slips(COLUMNS, strain, 0.3)
        assert np.linalg.norm(COLUMNS @ slip - strain) == pytest.approx(0.3, rel=1e-6)
        assert np.abs(slip).sum() == pytest.approx(answer["primal objective"], rel=1e-5)


def test_noisy_slips_scatter_about_the_truth_as_stated() -> None:
    truth = slips_of(systems_of_a_facet(), [0.03, 0.02, 0.0])
    noise = np.random.default_rng(5).standard_normal((300, 3))
    found = least_slip(COLUMNS, COLUMNS @ truth, NOISE**2 * np.eye(3))
    repeated = np.array([
        systems_refitted(COLUMNS / NOISE, COLUMNS @ truth / NOISE + one) for one in noise
    ])  # fmt: skip
    totals = np.abs(repeated).sum(axis=1)
    assert totals.std() == pytest.approx(found.total_sigma, rel=0.15)
    assert np.mean(np.abs(totals - 0.05) < 2.0 * found.total_sigma) > 0.9
    active = truth != 0.0
    scatter = np.sqrt(np.mean((repeated - truth)[:, active] ** 2, axis=0))
    assert scatter == pytest.approx(found.sigma[active], rel=0.3)


def test_pure_noise_stays_below_the_floor_as_often_as_stated() -> None:
    noise = np.random.default_rng(6).standard_normal((300, 3))
    found = least_slip(COLUMNS, np.zeros(3), NOISE**2 * np.eye(3))
    assert found.total == 0.0
    sums = [np.abs(systems_refitted(COLUMNS / NOISE, one)).sum() for one in noise]
    # Of 300 are 15 ± 4 above it, and the floor itself is known from 200.
    assert 0.90 < np.mean(np.array(sums) < found.floor) < 0.99


def test_a_system_with_a_twin_is_not_told_apart_and_one_without_others_is() -> None:
    columns = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    growth = growth_without(columns, np.array([0.02, 0.0, 0.01]))
    assert growth[0] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(growth[1]) and np.isinf(growth[2])
    assert np.isinf(growth_without(columns[:, :1], np.array([0.02]))).all()


def test_how_much_others_add_does_not_depend_on_how_large_the_slips_are() -> None:
    slip = slips_of(systems_of_a_facet(), [0.02, 0.01, 0.03])
    small, large = (growth_without(COLUMNS, size * slip) for size in (1e-6, 1.0))
    assert np.nanmin(large) > 1e-4
    assert small == pytest.approx(large, rel=1e-6, nan_ok=True)


def test_strains_that_no_slip_makes_are_fitted_as_well_as_can_be() -> None:
    slip = systems_refitted(np.array([[100.0], [0.0]]), np.array([3.0, 40.0]))
    assert slip == pytest.approx([0.03])

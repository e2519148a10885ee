import numpy as np
import pytest
from numpy.typing import NDArray

from driver.dic.basis import grid_basis
from driver.dic.regularisation import Penalty, penalties, ranks
from driver.dic.regularisation_evidence import Evidence, NoiseAndRoughness, weigh
from driver.dic.system import Pixels, System

SIGMA, ROUGH, ROUGH_W = 0.5, 0.2, 2.0


def drawn() -> tuple[System, NDArray[np.float64]]:
    """A system, and the d of 40 images whose motion was drawn from the prior."""
    rng = np.random.default_rng(0)
    rows, cols = (i.ravel().astype(float) for i in np.indices((50, 50)))
    xy = np.column_stack([rows, cols])
    bounds = (0.0, 49.0, 0.0, 49.0)
    uv, w = grid_basis(xy, bounds, 10.0), grid_basis(xy, bounds, 8.0)
    pixels = Pixels(rows, cols, rng.normal(size=2500), rng.normal(size=(2500, 2)), 1.0)
    system = System(pixels, uv, w, penalties(uv, w, None))
    roots = []
    for part, rough in zip(system.parts, (ROUGH, ROUGH_W), strict=True):
        values, vectors = np.linalg.eigh(np.asarray(part))
        kept = values > 1e-9
        roots.append(rough * vectors[:, kept] / np.sqrt(values[kept]))
    root = np.hstack(roots)
    true = rng.normal(size=(40, root.shape[1])) @ root.T
    noise = np.linalg.cholesky(2 * SIGMA**2 * np.asarray(system.hessian))
    return system, true @ system.hessian + rng.normal(size=(40, system.size)) @ noise.T


def test_the_roughness_that_the_motion_was_drawn_with_is_found() -> None:
    system, targets = drawn()
    first = NoiseAndRoughness(SIGMA, 1.0, 20.0)
    weigh(system, first, 1)
    start = system.solve(targets.T).T
    found, p = Evidence(
        system, ranks(system.basis_uv, system.basis_w, None), (True, True), 1
    ).settle(start, first, SIGMA)
    # known to about 1 in √(2 · 40 · rank), 1 %, less the share that noise hides; ends within 10 %
    assert found.roughness == pytest.approx(ROUGH, rel=0.1)
    assert found.roughness_w == pytest.approx(ROUGH_W, rel=0.1)
    assert p @ system.hessian + [system.penalty_force(q) for q in p] == pytest.approx(
        targets, abs=1e-8
    )


@pytest.mark.parametrize("penalty", ["tikhonov", "elastic", "equilibrium_gap"])
def test_ranks_are_those_of_the_penalties(penalty: Penalty) -> None:
    xy = np.array([[0.0, 0.0], [9.0, 9.0]])
    uv, w = (grid_basis(xy, (0.0, 9.0, 0.0, 9.0), size) for size in (3.0, 2.0))
    counted = [np.linalg.matrix_rank(np.asarray(r)) for r in penalties(uv, w, penalty)]
    assert list(ranks(uv, w, penalty)) == counted


def test_what_is_given_stays_and_only_the_noise_is_taken_over() -> None:
    system, targets = drawn()
    first = NoiseAndRoughness(3 * SIGMA, ROUGH, ROUGH_W)
    weigh(system, first, 1)
    start = system.solve(targets.T).T
    found, _ = Evidence(
        system, ranks(system.basis_uv, system.basis_w, None), (False, False), 1
    ).settle(start, first, SIGMA)
    assert found.sigma == SIGMA
    assert [found.roughness, found.roughness_w] == pytest.approx([ROUGH, ROUGH_W])
    assert system.weights[0] == pytest.approx(2 * SIGMA**2 / ROUGH**2)

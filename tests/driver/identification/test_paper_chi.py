from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from driver.identification.paper_chi import paper_chi
from tools import closed_form

BENCH = closed_form.problem()


def test_chi_is_that_of_the_equations_of_the_paper() -> None:
    """Equations 2.1, 4.1 and 4.2 term by term, over the images and loads in use."""
    data = replace(closed_form.objective(BENCH, BENCH.truth).data, left_out=(3,))
    data = data.frames(np.arange(1, 9))
    rng = np.random.default_rng(0)
    load = data.load + rng.standard_normal(data.load.size)
    rho = 0.004 * rng.standard_normal((8, len(data.image.images.xy)))
    gamma, N_f = data.image.images.sigma, rho.shape[1]
    chi_f = np.mean([np.sum(rho[t] ** 2) / (2 * gamma**2 * N_f) for t in (0, 1, 3, 4, 5, 6, 7)])
    chi_F = sum((data.load[t] - load[t]) ** 2 for t in range(1, 9)) / (data.load_noise**2 * 8)
    found = paper_chi(data, load, rho)
    assert found.chi_f == pytest.approx(np.sqrt(chi_f))
    assert found.chi_F == pytest.approx(np.sqrt(chi_F))
    both = N_f / (1 + N_f) * chi_f + 1 / (1 + N_f) * chi_F
    assert found.chi == pytest.approx(np.sqrt(both))


def test_noise_alone_leaves_what_the_mean_reference_spares() -> None:
    objective = closed_form.objective(BENCH, BENCH.truth, seed=3)
    here = objective.evaluate(BENCH.truth, ())
    found, images = here.paper, objective.data.image.images
    # √((1 + 1/n)/2), less what the interpolation of noisy frames smooths away.
    seen = here.motion + np.einsum("tr,rpc->tpc", here.shift, objective.data.image.rigid)
    variance = images.expected_residual_variance(seen).mean()
    assert variance <= (1 + 1 / closed_form.N_REPEATS) * images.sigma**2
    expected = np.sqrt(variance / (2 * images.sigma**2))
    # γ_f itself is an estimate.
    scatter = np.sqrt(0.5 / here.rho.size + 0.5 / images.noise_dof)
    assert found.chi_f == pytest.approx(expected, rel=4 * scatter)
    assert found.chi_F == pytest.approx(1.0, abs=3 / np.sqrt(2 * 44))

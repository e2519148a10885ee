from __future__ import annotations

import numpy as np

from driver.identification.kinematic_hessian import kinematic_hessian
from tools import closed_form

BENCH = closed_form.problem()
NAMES = ("lambda_plus_Y", "tau0", "depth_scale")


def test_it_is_the_sum_over_pixels_and_images_of_the_squared_change_of_the_residual() -> None:
    """Against ∇f·∂U/∂log p at every pixel, projected on the functions of the correlation mesh."""
    objective = closed_form.objective(BENCH, BENCH.truth)
    here = objective.evaluate(BENCH.truth, ("elongation_1", *NAMES))
    found = kinematic_hessian(objective, here, NAMES)
    image = objective.data.image
    change = []
    for name in NAMES:
        step = 1e-4 * BENCH.truth[name]
        above, below = (
            BENCH.model.predict(BENCH.truth | {name: BENCH.truth[name] + s * step}).motion
            for s in (1, -1)
        )
        seen = np.einsum("tpc,pc->tp", (above - below) / 2e-4, image.slope)
        rigid = np.einsum("rpc,pc->pr", image.rigid, image.slope)
        basis = np.column_stack([rigid, image.test.toarray()])
        seen -= (rigid @ np.linalg.lstsq(rigid, seen.T, rcond=None)[0]).T
        # Testing with ∇f·ψ keeps what these functions can show, less the rigid motions.
        left, strength, _ = np.linalg.svd(basis - rigid @ np.linalg.pinv(rigid) @ basis)
        left = left[:, : int(np.sum(strength > 1e-6 * strength[0]))]
        change.append((seen @ left).ravel())
    expected = np.array(change) @ np.array(change).T / (2 * image.images.sigma**2)
    np.testing.assert_allclose(found, expected, rtol=0.02, atol=0.02 * np.abs(expected).min())


def test_loads_prior_and_other_parameters_do_not_enter() -> None:
    objective = closed_form.objective(BENCH, BENCH.truth)
    augmented = objective.evaluate(BENCH.truth, (*NAMES, "load_gain"))
    alone = objective.evaluate(BENCH.truth, NAMES)
    np.testing.assert_allclose(
        kinematic_hessian(objective, augmented, NAMES), kinematic_hessian(objective, alone, NAMES)
    )

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from driver.case.specimen import SIZES
from driver.forward.build import adapter_of
from driver.virtual.truth import Course, true_model
from solver_adapters.interface import Simulation
from tools.beyond_parameters import SLICE, blistered, with_soft_slice
from tools.converged_truth import pulled, stage_history, true_case
from tools.short_specimen import true_knots


@cache
def bare() -> Course:
    return pulled({})


def simulation() -> Simulation:
    truth, history = true_case().with_values_at({f"specimen.{SIZES[0]}": 0.5}), stage_history()
    model, values = true_model(truth, history, adapter_of(truth), true_knots(history))
    return model.simulation(values)


def test_a_soft_slice_is_of_cells_of_grain_2_alone_that_end_where_it_does() -> None:
    before, after = simulation(), with_soft_slice(simulation(), 0.7)
    soft = after.mesh.grain == 2
    assert set(before.mesh.grain[soft]) == {1} and after.material.tau0_grains == (0.7,)
    np.testing.assert_array_equal(after.mesh.grain[~soft], before.mesh.grain[~soft])
    np.testing.assert_array_equal(after.orientations[2], before.orientations[1])
    y = after.mesh.points[after.mesh.cells[soft], 1]
    length = true_case().specimen.length
    ends = np.array([y.min(), y.max()]) / length
    # Layers are inclined as the boundary is, the less the further they are from it.
    np.testing.assert_allclose(ends, SLICE, atol=0.5 * 0.5 / length)


def test_a_blister_rises_on_one_spot_as_the_test_goes_on_and_shifts_nothing() -> None:
    blister = blistered(bare(), 0.04)
    more = blister.motion - bare().motion
    assert np.all(more[..., :2] == 0) and np.all(more[0] == 0)
    np.testing.assert_array_equal(blister.load, bare().load)
    assert more[-1, :, 2].max() == pytest.approx(0.04, rel=0.05)
    assert np.median(more[-1, :, 2]) < 0.1 * 0.04
    np.testing.assert_allclose(more[len(more) // 2], 0.5 * more[-1], atol=1e-12)

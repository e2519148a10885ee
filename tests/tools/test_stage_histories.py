from __future__ import annotations

import numpy as np

from tools.stage_histories import steady_history


def test_the_stage_moves_steadily_and_holds_at_each_peak_before_its_image() -> None:
    test = steady_history([(3, 1), (2, 2)], 5.0, 15.0, 30.0)
    at = test.image_row
    np.testing.assert_array_equal(test.stage[at], [0, 5, 10, 15, 10, 15, 20, 15, 10])
    np.testing.assert_array_equal(test.time[at], [0, 15, 30, 75, 90, 105, 150, 165, 180])
    np.testing.assert_array_equal(test.stage[test.turning], [0, 15, 10, 20, 10])

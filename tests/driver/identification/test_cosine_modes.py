from __future__ import annotations

import numpy as np
import pytest

from driver.identification.cosine_modes import cosine_modes, fast_modes


@pytest.mark.parametrize("T", [2, 31, 44])
def test_the_modes_are_orthonormal_and_the_fast_ones_are_the_last_half(T: int) -> None:
    modes = cosine_modes(T, np.arange(T))
    np.testing.assert_allclose(modes @ modes.T, np.eye(T), atol=1e-12)
    assert np.array_equal(fast_modes(T), modes[T // 2 :])


def test_a_course_as_slow_as_a_cycle_has_no_part_in_the_fast_ones() -> None:
    course = np.cos(2 * np.pi * (np.arange(44) + 0.5) / 44)
    assert np.abs(fast_modes(44) @ course).max() < 1e-12 < np.linalg.norm(course)

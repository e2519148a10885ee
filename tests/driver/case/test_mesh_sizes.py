from __future__ import annotations

import numpy as np
import pytest

from driver.case.mesh_sizes import LARGEST_RATIO, refined_sizes, sizes_at
from meshes.section import Section

DEPTH = 2 * np.sqrt(3)  # of an equilateral section, 4 µm wide
TRIANGLE = Section(4.0, DEPTH)


def test_the_first_hexahedra_are_two_and_one_in_a_section_of_four() -> None:
    assert sizes_at(TRIANGLE, "hex20", 0) == (2.0, 1.0)
    assert sizes_at(TRIANGLE, "hex20", 1) == (2.0, 0.667)
    assert sizes_at(TRIANGLE, "hex20", 3) == (1.0, 0.4)
    assert sizes_at(Section(8.0, 2 * DEPTH), "hex20", 0) == (4.0, 2.0)


@pytest.mark.parametrize("depth", [1.0, DEPTH, 9.0])
def test_each_refinement_of_hexahedra_divides_the_section_once_more(depth: float) -> None:
    before = 1
    for level in range(6):
        working, finer = sizes_at(Section(4.0, depth), "hex20", level)
        divisions = [Section(4.0, depth).divisions(size) for size in (working, finer)]
        assert divisions[1] == level + 2 == before + 1
        assert finer <= LARGEST_RATIO * working
        before = divisions[1]


def test_each_refinement_of_tetrahedra_takes_two_thirds() -> None:
    assert sizes_at(TRIANGLE, "tet10", 0) == (1.6, 1.11)
    for level in range(4):
        sizes, next_sizes = (sizes_at(TRIANGLE, "tet10", n) for n in (level, level + 1))
        np.testing.assert_allclose(next_sizes, np.array(sizes) * 2 / 3, rtol=5e-3)


def test_of_stated_sizes_the_finer_one_is_refined() -> None:
    assert refined_sizes(TRIANGLE, "hex20", (2.0, 0.5)) == (1.0, 0.4)
    assert refined_sizes(TRIANGLE, "hex20", (1.3, 0.9)) == (1.0, 0.667)
    assert refined_sizes(TRIANGLE, "tet10", (3.0, 2.0)) == (2.0, 1.33)

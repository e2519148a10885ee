from __future__ import annotations

import numpy as np

from solver_adapters.agreement import Agreement, force_error, motion_error, table


def test_forces_are_compared_with_the_peak_of_the_reference() -> None:
    assert force_error(np.array([1.0, -3.0, 2.5]), np.array([1.0, -4.0, 2.0])) == 25.0


def test_motions_are_compared_in_nanometres() -> None:
    found = np.zeros((2, 3, 3))
    found[1, 2, 0] = -0.004
    assert motion_error(found, np.zeros_like(found)) == 4.0


def test_a_line_names_figure_and_goal_and_a_row_of_the_table_the_same() -> None:
    rows = [Agreement("A and B", "force error [%]", 0.0612, 0.5), Agreement("C", "face [nm]", 2.0)]
    assert rows[0].line() == "A and B: force error [%] = 0.061 (goal: <= 0.5)"
    assert rows[1].line() == "C: face [nm] = 2"
    assert table(rows).splitlines()[2:] == [
        "| A and B | force error [%] | 0.061 | ≤ 0.5 |",
        "| C | face [nm] | 2 |  |",
    ]

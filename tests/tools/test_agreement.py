from __future__ import annotations

import numpy as np

from tests.solver_adapters.calculix.runs import needs_ccx
from tools.agreement import Agreement, force_error, motion_error, table
from tools.calculix_agreement import run_calculix


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


def test_a_goal_that_is_missed_is_said_to_be_with_what_makes_the_difference() -> None:
    missed = Agreement("A and B", "face [nm]", 0.8, 0.2, "other quadrature")
    assert missed.line() == "A and B: face [nm] = 0.8 (goal: <= 0.2; missed: other quadrature)"
    assert missed.row() == "| A and B | face [nm] | 0.8 | ≤ 0.2; missed: other quadrature |"
    assert Agreement("A", "face [nm]", 0.8, 0.2).row().endswith("≤ 0.2; missed |")
    assert Agreement("A", "face [nm]", 0.1, 0.2, "other quadrature").row().endswith("≤ 0.2 |")


@needs_ccx
def test_calculix_run_here_agrees_within_the_goals_on_the_prism() -> None:
    """Into the onset of flow, with the 484 cells of the stored run."""
    rows = list(run_calculix(0.9, 0.3))
    held = [row for row in rows if row.goal is not None]
    assert len(held) == 2
    assert all(row.found <= row.goal for row in held if row.goal is not None)
    # At equal steps they share the error of backward Euler.
    own, other = (row.found for row in rows if "backward" in row.quantity or "X:" in row.quantity)
    assert abs(own - other) < 0.1 * other

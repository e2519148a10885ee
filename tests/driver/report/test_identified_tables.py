import math

import numpy as np
import pytest

from driver.parameters.registry import declared_parameters
from driver.report.identified import IdentifiedParameter
from driver.report.identified_tables import (
    apex_table,
    budget_table,
    core,
    estimate_rows,
    law_table,
    strongest,
    time_table,
)

DECLARED = declared_parameters(3)


def estimate(
    name: str, start: float, value: float, sigma: float, width: float = math.inf
) -> IdentifiedParameter:
    parameter = DECLARED[name]
    deviation = sigma / parameter.slope(value)
    return IdentifiedParameter(
        parameter, start, value, deviation, start, width, (deviation / width) ** 2
    )


# Values of tables 4 and 5 of Bertin et al. (2016); the standard deviations are invented.
PAPER = {
    "lambda_plus_Y": estimate("lambda_plus_Y", 1.0, 0.81, 0.02, 1.0),
    "lambda_plus_Z": estimate("lambda_plus_Z", 1.0, 1.02, 0.18, 2.0),
    "elongation_1": estimate("elongation_1", 0.06, 0.0616, 0.002),
    "tilt_1": estimate("tilt_1", 0.01, 0.0168, 0.002),
    "tau0": estimate("tau0", 40.0, 21.0, 0.12, 1.0),
    "c": estimate("c", 40000.0, 44000.0, 400.0, 1.0),
    "d": estimate("d", 1500.0, 1140.0, 13.0, 1.0),
}


def test_a_row_says_start_prior_value_interval_and_the_share_of_the_prior() -> None:
    (_, (plus_y, plus_z)), (_, (tau0, c, _)) = estimate_rows(PAPER)[0]
    assert (plus_y["value"], plus_y["interval"]) == ("0.810 ± 0.020", "0.771 to 0.849")
    assert (plus_y["prior"], plus_y["share"], plus_y["unit"]) == ("0.80 to 1.2", "4 %", "1")
    assert plus_z["share"] == "81 %" and plus_z["decided"] and not plus_y["decided"]
    assert (tau0["start"], tau0["prior"], tau0["unit"]) == ("40.00", "5.6 to 280", "MPa")
    assert (c["value"], c["interval"], c["unit"]) == ("44.0 ± 0.4", "43.2 to 44.8", "GPa")
    assert tau0["share"] == "< 1 %" and tau0["bound"] == ""


def test_knots_stand_apart_in_nanometres_and_have_no_prior() -> None:
    groups = dict(estimate_rows(PAPER)[1])
    assert list(groups) == ["Elongation knots", "Tilt knots"]
    knot = groups["Elongation knots"][0]
    assert (knot["value"], knot["unit"]) == ("61.6 ± 2.0", "nm")
    assert (knot["prior"], knot["share"]) == ("none", "–")


def test_a_bound_that_was_reached_is_named() -> None:
    upper = DECLARED["lambda_plus_Y"].upper
    found = {"lambda_plus_Y": estimate("lambda_plus_Y", 1.0, upper, 0.1)}
    assert estimate_rows(found)[0][0][1][0]["bound"] == "at 5.00"


def test_apex_amplitudes_come_first_then_the_law_then_the_rest_without_knots() -> None:
    names = ["load_gain", "tau0", "elongation_1", "origin_X", "lambda_plus_Y", "c"]
    assert core(names) == ["lambda_plus_Y", "tau0", "c", "load_gain"]


def test_strong_correlations_are_named_the_strongest_first() -> None:
    matrix = np.array([[1.0, 0.2, 0.71], [0.2, 1.0, -0.93], [0.71, -0.93, 1.0]])
    said = strongest(["tau0", "c", "d"], matrix)
    assert said == "Strongest: c and d (−0.93) and τ₀ and d (+0.71)."
    assert strongest(["c", "d"], np.eye(2)) == (
        "No two of these parameters are correlated beyond ± 0.7."
    )


def test_the_apex_table_goes_from_free_correlation_to_the_result() -> None:
    amplitudes = {"lambda_plus_Y": (1.0, 0.81, 0.02), "lambda_plus_Z": (1.0, 1.02, None)}
    table = apex_table(amplitudes, 3.7, (4.46, 4.5))
    assert table.head == ("", "χ_f", "λ⁺_Y", "λ⁺_Z")
    assert table.rows == (
        ("free correlation (DIC)", "3.70", "–", "–"),
        ("start", "4.46", "1.00", "1.00"),
        ("identified", "4.50", "0.810 ± 0.020", "1.020"),
    )


def test_the_law_table_has_units_in_its_head_and_the_residuals_at_both_ends() -> None:
    paper = {"chi": (4.64, 4.52), "chi_f": (4.46, 4.47), "chi_F": (78.0, 58.0)}
    table = law_table(PAPER, paper)
    assert table.head == ("", "χ", "χ_f", "χ_F over γ_F alone", "τ₀ [MPa]", "c [GPa]", "d")
    assert table.rows == (
        ("start", "4.64", "4.46", "78.0", "40.00", "40.00", "1500"),
        ("identified", "4.52", "4.47", "58.0", "21.00 ± 0.12", "44.0 ± 0.4", "1140 ± 13"),
    )


def test_the_budget_goes_from_noise_over_free_correlation_to_the_models() -> None:
    side = {"model": 4.5, "basis": 6.0, "load": 58.0}
    table = budget_table((3.7, 2.7), {"identified model": side}, {"identified model": 3.3}, 0.742)
    assert table.rows == (
        ("noise alone", "1.00", "0.74", "1.00", "1.00"),
        ("free correlation (DIC)", "3.70", "2.70", "–", "–"),
        ("identified model", "4.50", "3.30", "6.00", "58.0"),
    )


@pytest.mark.parametrize("total", [1.0, 1200.0])
def test_times_are_told_with_their_share_and_their_sum(total: float) -> None:
    table = time_table({"measure": 0.25 * total, "identify A": 0.75 * total})
    assert [row[2] for row in table.rows] == ["25 %", "75 %", "100 %"]
    assert table.rows[-1][1] == {1.0: "1.0 s", 1200.0: "20.0 min"}[total]

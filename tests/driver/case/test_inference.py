from __future__ import annotations

from typing import Any

import pytest

from driver.case.inference import DiagnosisTable, Identification
from solver_adapters.material import MATERIAL_DECLARATIONS
from tests.driver.case.tables import refused


def test_a_prior_width_that_is_not_given_is_one() -> None:
    table = Identification(prior_width={"tau0": 0.25})
    assert [table.width(name) for name in ("tau0", "c")] == [0.25, 1.0]


def test_every_constant_of_the_law_can_be_identified_and_nothing_else() -> None:
    names = tuple(parameter.name for parameter in MATERIAL_DECLARATIONS)
    assert Identification(parameters=names).parameters == names
    for other in ("C11", "load_gain", "elongation_1"):
        assert refused(Identification, parameters=(other,))[0] == "parameters"


@pytest.mark.parametrize(
    ("keys", "place"),
    [
        ({"parameters": ()}, "parameters"), ({"parameters": ("tau0", "tau0")}, "parameters"),
        ({"prior": "tikhonov"}, "lambda_star"), ({"lambda_star": 1e-6}, "lambda_star"),
        ({"prior": "none", "lambda_star": 1e-6}, "lambda_star"),
        ({"prior_width": {"n": 1.0}}, "prior_width"),
        ({"prior_width": {"tau0": 0.0}}, "prior_width.tau0"),
    ],
)  # fmt: skip
def test_priors_and_parameters_that_do_not_go_together_are_refused(
    keys: dict[str, Any], place: str
) -> None:
    assert refused(Identification, **keys)[0] == place


def test_the_weight_of_the_paper_goes_with_its_prior() -> None:
    assert Identification(prior="tikhonov", lambda_star=1e-6).lambda_star == 1e-6


def test_causes_are_all_or_named_once_each() -> None:
    assert DiagnosisTable().causes == "all"
    assert DiagnosisTable(causes=("load_gain", "mine")).causes == ("load_gain", "mine")
    assert refused(DiagnosisTable, causes=("load_gain", "load_gain"))[1] == "each name once"
    assert "at least one name" in refused(DiagnosisTable, causes=())[1]


@pytest.mark.parametrize("asked", ["last", "none", 1, 7])
def test_a_cycle_is_held_out_by_its_number_from_one_or_by_a_word(asked: Any) -> None:
    assert DiagnosisTable(held_out_cycle=asked).held_out_cycle == asked

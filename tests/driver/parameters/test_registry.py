from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import get_args

import pytest

from driver.case.material import MaterialTable
from driver.case.model import default_case
from driver.parameters import registry
from driver.parameters.boundary import LAMBDAS
from driver.parameters.covariance import COVARIANCE_PARAMETERS, SIGMA_E
from driver.parameters.instrument import LOAD_DECLARATIONS
from driver.parameters.registry import (
    declaration_of,
    declared_parameters,
    label_of,
    short_label_of,
)
from driver.report.style import INDEXED
from solver_adapters.material import MATERIAL_DECLARATIONS, MATERIAL_PARAMETERS, Material
from solver_adapters.parameter import Parameter, Place

EVERY = {**declared_parameters(4), **COVARIANCE_PARAMETERS}


def test_every_declared_null_lies_inside_its_bounds() -> None:
    for parameter in declared_parameters(5).values():
        assert parameter.lower <= parameter.null <= parameter.upper and parameter.scale > 0
        assert not parameter.logarithmic or parameter.lower > 0


def test_every_parameter_stands_under_its_own_name() -> None:
    assert all(name == parameter.name for name, parameter in declared_parameters(3).items())


def test_there_are_an_elongation_and_a_tilt_for_each_knot_but_the_first() -> None:
    bare, more = set(declared_parameters(1)), set(declared_parameters(4))
    assert more - bare == {f"{what}_{k}" for what in ("elongation", "tilt") for k in (1, 2, 3)}
    assert bare < more


def test_every_place_of_the_model_has_parameters_but_the_covariance() -> None:
    """Levels of noise are no parameters of a model."""
    counted = Counter(parameter.enters for parameter in declared_parameters(2).values())
    assert set(counted) == set(get_args(Place)) - {"covariance"}
    assert (counted["knots"], counted["orientations"], counted["pixels"]) == (2, 9, 2)


def test_what_enters_the_law_is_a_constant_of_the_material_and_a_key_of_the_case() -> None:
    law = [p for p in declared_parameters(2).values() if p.enters == "law"]
    # The elastic constants are scaled, not fitted one by one.
    fixed = {"C11", "C12", "C44"}
    assert {parameter.name for parameter in law} == set(MATERIAL_PARAMETERS) - fixed
    keys = {parameter.key for parameter in law}
    assert keys <= {f"material.{field}" for field in MaterialTable.model_fields}


def test_scales_and_bounds_that_hang_on_the_material_are_those_of_the_one_given() -> None:
    """|x0| stays below 1/d, the saturated back strain."""
    paper, other = (declared_parameters(2, replace(Material(), d=d)) for d in (1500.0, 300.0))
    assert other["x0"].scale == 5 * paper["x0"].scale
    assert other["x0"].upper == 5 * paper["x0"].upper < 1 / 300.0
    changed = {name for name in paper if paper[name] != other[name]}
    assert "x0" in changed and "tau0" not in changed
    assert declared_parameters(2) == declared_parameters(2, Material())


@pytest.mark.parametrize("name", EVERY)
def test_the_declaration_of_a_parameter_is_found_by_its_name(name: str) -> None:
    assert declaration_of(name) == EVERY[name]


def test_levels_of_noise_are_no_parameters_of_the_general_model() -> None:
    assert not set(COVARIANCE_PARAMETERS) & set(declared_parameters(4))


def test_every_parameter_has_a_label_of_its_own_without_underscores() -> None:
    labels = {name: label_of(name) for name in EVERY}
    assert not [name for name, text in labels.items() if "_" in INDEXED.sub("", text)]
    assert len(set(labels.values())) == len(labels)


def test_labels_come_from_the_declarations(monkeypatch: pytest.MonkeyPatch) -> None:
    shorter = tuple(
        replace(one, label=f"label of {one.name}", short="") for one in LOAD_DECLARATIONS
    )
    monkeypatch.setattr(registry, "LOAD_DECLARATIONS", shorter)
    assert label_of("load_gain") == short_label_of("load_gain") == "label of load_gain"


def test_what_is_declared_no_more_or_without_a_label_is_written_by_its_name() -> None:
    assert declaration_of("gone_term") is None
    assert label_of("gone_term") == short_label_of("gone_term") == "gone_term"
    assert label_of("c") == "c" and declaration_of("elongation_0") is None


def test_beside_a_matrix_labels_are_short() -> None:
    assert short_label_of("elongation_3") == "ΔU_Y 3" and short_label_of("origin_X") == "origin X"
    assert max(len(short_label_of(name)) for name in EVERY if "lambda" in name) <= 4


@pytest.mark.parametrize("parameter", EVERY.values(), ids=lambda one: one.name)
def test_the_keys_of_a_declaration_lead_to_a_number_of_the_case(parameter: Parameter) -> None:
    """Nulls of the case are those of the declarations, but for the constants of the law."""
    case = default_case()
    if parameter.key:
        stated = case.value_at(parameter.key)
        assert stated == getattr(case.material.to_material(), parameter.name, parameter.null)
    if parameter.deviation_key:
        assert case.value_at(parameter.deviation_key) == 0.0


def test_laws_and_apex_amplitudes_have_a_start_in_the_case_and_all_others_are_extensions() -> None:
    stated = {name for name, parameter in EVERY.items() if parameter.key}
    assert stated == {*LAMBDAS, *(one.name for one in MATERIAL_DECLARATIONS), SIGMA_E.name}


def test_scales_that_measured_files_tell_stand_in_place_of_the_declared_ones() -> None:
    told = declared_parameters(2, scales={"rotation_grain1_x": 0.1})
    assert told["rotation_grain1_x"].scale == 0.1
    assert told["rotation_grain1_y"] == declared_parameters(2)["rotation_grain1_y"]
    assert list(told) == list(declared_parameters(2))

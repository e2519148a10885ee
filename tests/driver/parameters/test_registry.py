from __future__ import annotations

from dataclasses import replace

import pytest

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
from solver_adapters.material import MATERIAL_DECLARATIONS
from solver_adapters.parameter import Parameter

EVERY = {**declared_parameters(4), **COVARIANCE_PARAMETERS}


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

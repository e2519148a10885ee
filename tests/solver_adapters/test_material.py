from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver_adapters.grain_scalars import INSIDE_NULL, inside_names
from solver_adapters.material import (
    ELASTIC_CONSTANTS,
    MATERIAL_DECLARATIONS,
    MATERIAL_PARAMETERS,
    OF_SECOND_GRAIN,
    Constant,
    Material,
    admissible_at,
    declarations_at,
    least_C11,
    scalar,
    with_parameters,
)
from solver_adapters.parameter import Parameter, Range


@pytest.mark.parametrize("parameter", MATERIAL_DECLARATIONS, ids=lambda p: p.name)
def test_a_parameter_that_is_declared_is_at_its_null_by_default(parameter: Parameter) -> None:
    assert parameter.name in MATERIAL_PARAMETERS
    assert getattr(Material(), parameter.name) == parameter.null


def test_back_stresses_are_scaled_by_the_saturation_of_the_case() -> None:
    at = {p.name: p for p in declarations_at(Material(d=500.0, d2=40.0))}
    assert at["x0"].scale == pytest.approx(2e-4) and at["x0"].upper == pytest.approx(6e-4)
    # 10 MPa of saturated slow back stress, which recovers ten times more slowly than the first.
    assert at["c2"].scale == pytest.approx(400.0) and at["d2"].upper == pytest.approx(50.0)
    assert at["c2"].scale / 40.0 == pytest.approx(10.0)


@pytest.mark.parametrize("name", MATERIAL_PARAMETERS)
def test_every_scalar_of_the_law_is_declared_once_with_what_it_may_be(name: str) -> None:
    every: tuple[Constant | Parameter, ...] = (*ELASTIC_CONSTANTS, *MATERIAL_DECLARATIONS)
    declared = [one for one in every if one.name == name]
    assert len(declared) == 1 and declared[0].key.startswith("material.")
    assert declared[0].admissible.holds(getattr(Material(), name))


@pytest.mark.parametrize("parameter", MATERIAL_DECLARATIONS, ids=lambda p: p.name)
def test_a_fit_stays_within_what_is_admissible(parameter: Parameter) -> None:
    assert parameter.admissible.holds(parameter.lower) and parameter.admissible.holds(
        parameter.upper
    )


def test_a_range_holds_finite_numbers_between_its_bounds_and_an_open_one_not_the_bounds() -> None:
    closed, unbounded = Range("from 1 to 2", 1, 2), Range("any")
    opened = replace(closed, open=True)
    assert [closed.holds(value) for value in (0.9, 1, 1.5, 2, 2.1)] == [False, *3 * [True], False]
    assert [opened.holds(value) for value in (1, 1.5, 2)] == [False, True, False]
    assert unbounded.holds(-1e300)
    assert not any(r.holds(v) for r in (closed, unbounded) for v in (np.nan, np.inf, -np.inf))


@pytest.mark.parametrize("C12", [100.0, 0.0, -30.0])
def test_the_least_C11_parts_stable_crystals_from_others(C12: float) -> None:
    """The cubic stiffness has the eigenvalues C11 − C12 (twice) and C11 + 2 C12."""
    for C11, stable in ((least_C11(C12) + 1e-6, True), (least_C11(C12) - 1e-6, False)):
        block = np.full((3, 3), C12) + np.diag(np.full(3, C11 - C12))
        assert (np.linalg.eigvalsh(block).min() > 0) == stable


def test_an_initial_back_strain_is_bounded_by_the_recall_of_the_case() -> None:
    assert admissible_at(Material(d=500.0))["x0"].upper == 2e-3
    assert admissible_at(Material(d=0.0))["x0"].holds(10.0)


def test_ratios_of_later_grains_are_scalars_by_the_number_of_the_grain() -> None:
    law = with_parameters(Material(tau0_grains=(1.2,)), {"tau0_grain4": 1.5, "tau0_grain2": 0.9})
    assert (law.tau0_grain2, law.tau0_grains) == (0.9, (1.2, 1.5))
    assert [scalar(law, f"tau0_grain{grain}") for grain in (2, 3, 4, 5)] == [0.9, 1.2, 1.5, 1.0]
    # At their nulls they leave the law, and with it the key of a job, as it is.
    assert with_parameters(law, {"tau0_grain3": 1.0, "tau0_grain4": 1.0}).tau0_grains == ()
    names = [parameter.name for parameter in declarations_at(Material(), 4)]
    assert [name for name in names if name.startswith("tau0_grain") and name[-1].isdigit()] == [
        "tau0_grain2", "tau0_grain3", "tau0_grain4",
    ]  # fmt: skip
    assert declarations_at(Material(), 2) == MATERIAL_DECLARATIONS


def test_what_varies_inside_a_later_grain_is_scalars_by_the_number_of_the_grain() -> None:
    law = with_parameters(Material(tau0_grains=(1.2,)), {"tau0_grain4_band": -0.4})
    assert law.tau0_grains == (1.2,)
    assert law.tau0_grains_inside == (INSIDE_NULL, (0.0, 0.0, 0.0, -0.4, 0.0, 0.25))
    wide = with_parameters(law, {"tau0_grain4_band_half_width": 0.3, "tau0_grain3_slope_X": 0.1})
    assert [scalar(wide, name) for name in inside_names(3)] == [0.0, 0.0, 0.1, 0.0, 0.0, 0.25]
    assert [scalar(wide, name) for name in inside_names(4)] == [0.0, 0.0, 0.0, -0.4, 0.0, 0.3]
    ratios = with_parameters(Material(tau0_grains=(1.0, 1.2)), {"tau0_grain3_band": 0.1})
    assert (ratios.tau0_grains, len(ratios.tau0_grains_inside)) == ((1.0, 1.2), 1)
    assert with_parameters(law, {"tau0_grain3": 0.9}).tau0_grains_inside == law.tau0_grains_inside
    assert [scalar(wide, name) for name in inside_names(5)] == list(INSIDE_NULL)
    # At their nulls they leave the law, and with it the key of a job, as it is.
    assert with_parameters(law, {"tau0_grain4_band": 0.0}) == Material(tau0_grains=(1.2,))


def test_a_later_grain_is_declared_as_the_second_one_is() -> None:
    declared = {parameter.name: parameter for parameter in declarations_at(Material(), 4)}
    second = {name: parameter for name, parameter in declared.items() if name in OF_SECOND_GRAIN}
    for grain in (3, 4):
        for name, parameter in second.items():
            later = declared[name.replace("grain2", f"grain{grain}")]
            label = parameter.label.replace("grain 2", f"grain {grain}")
            assert later == replace(parameter, name=later.name, label=label, key="")
            assert label != parameter.label
    assert len(declared) == len(MATERIAL_DECLARATIONS) + 2 * len(second)

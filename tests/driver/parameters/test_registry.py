from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import get_args

from driver.case.material import MaterialTable
from driver.parameters.registry import declared_parameters
from solver_adapters.material import MATERIAL_PARAMETERS, Material
from solver_adapters.parameter import Place


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
    """Levels of noise are declared by their causes: no model takes them."""
    counted = Counter(parameter.enters for parameter in declared_parameters(2).values())
    assert set(counted) == set(get_args(Place)) - {"covariance"}
    assert (counted["knots"], counted["orientations"], counted["pixels"]) == (2, 9, 2)


def test_what_enters_the_law_is_a_constant_of_the_material_and_a_key_of_the_case() -> None:
    law = [p for p in declared_parameters(2).values() if p.enters == "law"]
    # The elastic constants are scaled, not fitted one by one.
    fixed = {"C11", "C12", "C44"}
    assert {parameter.name for parameter in law} == set(MATERIAL_PARAMETERS) - fixed
    keys = {parameter.key or parameter.name for parameter in law}
    assert keys <= set(MaterialTable.model_fields)


def test_scales_and_bounds_that_hang_on_the_material_are_those_of_the_one_given() -> None:
    """|x0| stays below 1/d, the saturated back strain."""
    paper, other = (declared_parameters(2, replace(Material(), d=d)) for d in (1500.0, 300.0))
    assert other["x0"].scale == 5 * paper["x0"].scale
    assert other["x0"].upper == 5 * paper["x0"].upper < 1 / 300.0
    changed = {name for name in paper if paper[name] != other[name]}
    assert "x0" in changed and "tau0" not in changed
    assert declared_parameters(2) == declared_parameters(2, Material())

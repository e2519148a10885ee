from __future__ import annotations

import pytest

from solver_adapters.material import (
    MATERIAL_DECLARATIONS,
    MATERIAL_PARAMETERS,
    Material,
    declarations_at,
)
from solver_adapters.parameter import Parameter


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

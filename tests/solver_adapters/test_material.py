from __future__ import annotations

import pytest

from solver_adapters.material import MATERIAL_DECLARATIONS, MATERIAL_PARAMETERS, Material
from solver_adapters.parameter import Parameter


@pytest.mark.parametrize("parameter", MATERIAL_DECLARATIONS, ids=lambda p: p.name)
def test_a_parameter_that_is_declared_is_at_its_null_by_default(parameter: Parameter) -> None:
    assert parameter.name in MATERIAL_PARAMETERS
    assert getattr(Material(), parameter.name) == parameter.null

from __future__ import annotations

import pytest

from solver_adapters.material import MATERIAL_PARAMETERS, Material


@pytest.mark.parametrize(
    ("name", "null"),
    [
        ("Q", 0.0),
        ("tau0_112", 1.0),
        ("tau0_grain2", 1.0),
        ("elastic_scale", 1.0),
        ("C44_scale", 1.0),
    ],
)
def test_an_extension_is_at_its_null_by_default(name: str, null: float) -> None:
    assert name in MATERIAL_PARAMETERS
    assert getattr(Material(), name) == null

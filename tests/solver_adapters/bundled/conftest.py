"""The choices that most claims about the bundled solver are made for."""

from __future__ import annotations

import pytest

from solver_adapters.bundled import equilibrium
from solver_adapters.bundled.linear.split_matrix import RESIDUAL
from solver_adapters.material import StrainMeasure


@pytest.fixture(params=["tet10", "hex20"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture(params=["small", "finite"])
def measure(request: pytest.FixtureRequest) -> StrainMeasure:
    name: StrainMeasure = request.param
    return name


@pytest.fixture
def exact_newton(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method solves its linear systems exactly.

    For claims about digits far below the tolerance of a run.
    """
    monkeypatch.setattr(equilibrium, "_accuracy", lambda *_: RESIDUAL)

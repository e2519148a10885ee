from __future__ import annotations

import pytest

from solver_adapters.bundled.law import point_kernels
from tools import compiled_kernels


def test_both_laws_and_their_derivatives_are_at_work() -> None:
    compiled_kernels.simulate("small", "tet10")
    compiled_kernels.simulate("finite", "tet10")
    for name in ("update_small", "derive_small", "update_finite", "derive_finite"):
        assert getattr(point_kernels, name).signatures, name


def test_kernels_that_were_compiled_before_are_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def side_by_side(work: object, tasks: range, processes: int) -> None:
        done.extend(tasks)

    monkeypatch.setattr(compiled_kernels, "side_by_side", side_by_side)
    monkeypatch.setattr(compiled_kernels, "compiled_before", lambda: True)
    compiled_kernels.main()
    assert done == []
    monkeypatch.setattr(compiled_kernels, "compiled_before", lambda: False)
    compiled_kernels.main()
    assert done == list(range(len(compiled_kernels.TASKS)))

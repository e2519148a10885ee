from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from driver.case.model import Case, default_case, write_case
from driver.forward import build
from driver.results.hdf5 import ResultError
from driver.results.mesh_sizes import (
    Refinements,
    read_refinements,
    refined,
    sized,
    sized_case,
    write_refinements,
)
from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.interface import Capabilities
from tests.driver.stated_sizes import stated_case
from tools.closed_form import ClosedFormSolver

ABLE: Capabilities = BundledAdapter().capabilities()


def chosen(case: Case, solver: Capabilities | None = ABLE) -> tuple[object, ...]:
    specimen = sized(case, solver).specimen
    return specimen.cell_kind, specimen.mesh_size, specimen.fine_mesh_size, specimen.refined


def with_specimen(**keys: Any) -> Case:
    return default_case().with_values_at({f"specimen.{key}": value for key, value in keys.items()})


def test_hexahedra_are_chosen_where_solver_and_grain_boundary_allow_them() -> None:
    assert chosen(default_case()) == ("hex20", 2.0, 1.0, 0)
    tetrahedra = ("tet10", 1.6, 1.11, 0)
    assert chosen(default_case(), replace(ABLE, mean_dilatation=False)) == tetrahedra
    assert chosen(default_case(), replace(ABLE, cells=frozenset({10}))) == tetrahedra
    assert chosen(default_case(), None) == tetrahedra
    # A boundary that meets an end face is none that layers could follow.
    assert chosen(with_specimen(boundary_normal=(1.0, 0.1, 0.0))) == tetrahedra
    single = with_specimen(boundary_point_um=None, boundary_normal=None)
    assert chosen(single) == ("hex20", 2.0, 1.0, 0)


def test_cells_and_sizes_that_are_stated_are_kept() -> None:
    assert chosen(with_specimen(cells="tet10")) == ("tet10", 1.6, 1.11, 0)
    lacking = replace(ABLE, cells=frozenset({10}))
    assert chosen(with_specimen(cells="hex20"), lacking) == ("hex20", 2.0, 1.0, 0)
    stated = stated_case()
    assert sized(stated, ABLE) is stated


def test_a_case_has_the_sizes_to_which_its_results_were_refined(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(build, "find_adapter", lambda name, profile: ClosedFormSolver(0.001))
    path, results = tmp_path / "case.toml", tmp_path / "results"
    write_case(default_case(), path)
    first = sized_case(path)
    results.mkdir()
    write_refinements(results, Refinements(1, 12.5))
    assert read_refinements(results) == Refinements(1, 12.5)
    second = sized_case(path)
    assert second.specimen.refined == 1 and second.specimen == refined(first).specimen
    assert second.specimen.mesh_size < first.specimen.mesh_size
    # Stated sizes know of none.
    write_case(stated_case(), path)
    assert sized_case(path).specimen == stated_case().specimen


def test_before_any_run_nothing_is_refined(tmp_path: Path) -> None:
    assert read_refinements(tmp_path) == Refinements(0, 0.0)


@pytest.mark.parametrize("text", ["{", "{}", '{"refined": -1, "seconds_before": 0}'])
def test_a_damaged_record_of_refinements_is_told(tmp_path: Path, text: str) -> None:
    (tmp_path / "sizes.json").write_text(text)
    with pytest.raises(ResultError, match=r"sizes.json: found no .*; delete it"):
        read_refinements(tmp_path)

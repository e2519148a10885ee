"""The extended model goes to other solvers where they can honour it, and nowhere else."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from pathlib import Path

import numpy as np
import pytest

from driver.forward.build import adapter_of, build_model, mesh_of
from driver.forward.model import ForwardModel
from driver.results.extended_decks import write_decks
from driver.results.files import DECKS
from driver.virtual.truth import stage_program
from solver_adapters import registry
from tools.short_specimen import small_case

CASE = small_case()


def model() -> ForwardModel:
    """{112} does not slip, so that CalculiX can take it."""
    case = CASE.model_copy(
        update={"material": CASE.material.model_copy(update={"tau0_112": 2000.0})}
    )
    mesh, history = mesh_of(case, 4.0), stage_program([(1, 1)])
    return build_model(case, mesh, history, np.zeros((0, 2)), adapter_of(case), 1)


MODEL = model()
NULL = MODEL.null_values()


def test_a_cause_that_a_solver_knows_stands_in_its_deck(tmp_path: Path) -> None:
    told = write_decks(tmp_path, CASE, MODEL, NULL | {"tau0_grain2": 1.25})
    assert told == {"calculix": None, "code_aster": None}
    for name in told:
        assert any((tmp_path / DECKS / name).iterdir())
    decks = []
    for grain, value in (("one", 1.0), ("more", 1.25)):
        write_decks(tmp_path / grain, CASE, MODEL, NULL | {"tau0_grain2": value})
        decks.append((tmp_path / grain / DECKS / "calculix" / "job.inp").read_text("utf-8"))
    assert decks[0] != decks[1]


def test_a_cause_that_a_solver_does_not_know_is_refused_with_its_name(tmp_path: Path) -> None:
    told = write_decks(tmp_path, CASE, MODEL, NULL | {"x0": 1e-4})
    assert not (tmp_path / DECKS).exists()
    assert all("x0" in (told[name] or "") for name in ("calculix", "code_aster"))


def test_a_solver_that_cannot_be_loaded_is_told_beside_the_decks_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = entry_points(group=registry.GROUP)
    broken = EntryPoint("broken", "no_such_package:Solver", registry.GROUP)
    monkeypatch.setattr(registry, "entry_points", lambda group: (*points, broken))
    told = write_decks(tmp_path, CASE, MODEL, NULL)
    assert "the solver broken: found no usable no_such_package:Solver" in (told["broken"] or "")
    assert told["calculix"] is None and told["code_aster"] is None


def test_a_cause_of_the_instrument_changes_no_deck(tmp_path: Path) -> None:
    decks = []
    for name, gain in (("none", 0.0), ("some", 0.05)):
        write_decks(tmp_path / name, CASE, MODEL, NULL | {"load_gain": gain})
        decks.append((tmp_path / name / DECKS / "calculix" / "job.inp").read_bytes())
    assert decks[0] == decks[1]

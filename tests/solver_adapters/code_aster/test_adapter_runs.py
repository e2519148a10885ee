"""The bundled solver and today's deck against jobs that a real Code_Aster 15.2 ran."""

from __future__ import annotations

import ast
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.code_aster.result import read
from solver_adapters.interface import Simulation
from tools.code_aster_runs import (
    NAMES,
    RUNS,
    at_the_end,
    results,
    simulation,
)

ADAPTER = CodeAsterAdapter()


def bundled(asked: Simulation, ends: np.ndarray, points: int) -> Simulation:
    """The same for the bundled solver, in the steps that the program took."""
    return replace(asked, steps=ends, tet10_points=points)


def test_there_is_a_run_for_every_term_of_the_law_that_the_adapter_offers() -> None:
    null = simulation("null").material
    changed = {
        name
        for run in NAMES
        for name in ADAPTER.capabilities().material
        if getattr(simulation(run).material, name) != getattr(null, name)
    }
    # Every cubic crystal of the case has these.
    assert ADAPTER.capabilities().material - changed == {"C11", "C12", "C44"}


@pytest.mark.parametrize("name", NAMES)
def test_the_bundled_solver_answers_as_the_program_did_at_equal_gauss_points(
    name: str, tmp_path: Path
) -> None:
    folder, asked = results(name, tmp_path), simulation(name)
    motion = read(replace(asked, cell_fields=False), folder)
    own = BundledAdapter().solve(bundled(asked, motion.ends, 5))
    assert own.cuts == 0
    largest = abs(motion.force).max()
    np.testing.assert_allclose(own.force, motion.force, rtol=0, atol=5e-9 * largest)
    np.testing.assert_allclose(own.displacement, motion.displacement, rtol=0, atol=5e-10)


@pytest.mark.parametrize("name", NAMES)
def test_the_cells_of_the_bundled_solver_are_those_of_the_program(
    name: str, tmp_path: Path
) -> None:
    asked = at_the_end(simulation(name))
    found = read(asked, results(name, tmp_path))
    own = BundledAdapter().solve(bundled(asked, found.ends, 5))
    assert found.cells is not None and own.cells is not None
    for field in ("stress", "slip", "accumulated_slip", "rotation"):
        expected, mine = getattr(found.cells, field), getattr(own.cells, field)
        largest = abs(expected).max()
        assert largest > 0
        np.testing.assert_allclose(mine, expected, rtol=0, atol=1e-7 * largest, err_msg=field)


@pytest.mark.parametrize("name", NAMES)
def test_the_deck_of_today_says_what_the_deck_that_ran_said(name: str) -> None:
    """Keyword by keyword: trees of Python, in which comments and layout do not count."""
    deck = ADAPTER.files(simulation(name))["job.comm"].decode("ascii")
    ran = (RUNS / name / "job.comm").read_text(encoding="ascii")
    assert ast.dump(ast.parse(deck), indent=1) == ast.dump(ast.parse(ran), indent=1)


def test_four_gauss_points_are_a_percent_off_on_these_coarse_cells(tmp_path: Path) -> None:
    """So that the agreement above would not hide another quadrature."""
    folder, asked = results("null", tmp_path), simulation("null")
    found = read(replace(asked, cell_fields=False), folder)
    own = BundledAdapter().solve(bundled(replace(asked, cell_fields=False), found.ends, 4))
    off = abs(own.force - found.force).max() / abs(found.force).max()
    assert 5e-3 < off < 2e-2

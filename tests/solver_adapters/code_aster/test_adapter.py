"""The adapter as the case file names it, and a run where Code_Aster is installed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.external import Profile
from solver_adapters.interface import Simulation
from tools.code_aster_cases import small_case

ADAPTER = CodeAsterAdapter()


def test_it_offers_backward_euler_in_both_strain_measures_with_a_word_about_one() -> None:
    offered = ADAPTER.capabilities()
    assert offered.integrations == {"backward_euler"} and not offered.derivatives
    assert offered.strain_measures == {"small", "finite"}
    assert list(offered.cautions) == ["finite"]


def test_the_program_is_called_with_the_export_file() -> None:
    container = ("apptainer", "exec", "aster.sif", "run_aster")
    for program in (("run_aster",), container):
        assert ADAPTER.command(program) == (*program, "--wrkdir", "run_aster", "job.export")


@pytest.mark.skipif(ADAPTER.program() is None, reason="run_aster is not on PATH")
@pytest.mark.parametrize(
    "case",
    [
        pytest.param(small_case(), id="null"),
        pytest.param(
            small_case(tau0_grain2=1.2, elastic_scale=0.9, C44_scale=1.1),
            id="grain and elasticity",
            marks=pytest.mark.slow,
        ),
        pytest.param(small_case(tau0_112=1.25, Q=10.0), id="families", marks=pytest.mark.slow),
        pytest.param(
            small_case(Q=10.0, h_latent=1.4), id="latent hardening", marks=pytest.mark.slow
        ),
    ],
)
def test_a_real_run_answers_as_the_bundled_solver_at_equal_gauss_points(
    case: Simulation, tmp_path: Path
) -> None:
    case = replace(case, cell_fields=True)
    found = CodeAsterAdapter(Profile(wall_time=600.0)).solve(case, tmp_path)
    same = replace(case, steps=found.ends, cell_fields=False, tet10_points=5)
    expected = BundledAdapter().solve(same)
    largest = abs(expected.force).max()
    np.testing.assert_allclose(found.force, expected.force, rtol=0, atol=1e-5 * largest)
    np.testing.assert_allclose(found.displacement, expected.displacement, rtol=0, atol=1e-6)

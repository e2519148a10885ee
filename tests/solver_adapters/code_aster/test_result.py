"""The response that is read from a job of Code_Aster 15.2 on the prism."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver_adapters.code_aster.adapter import CodeAsterAdapter
from solver_adapters.code_aster.deck import FORCES, LISTING, NODES
from solver_adapters.interface import Simulation
from solver_adapters.result_files import ResultFileError
from tools.code_aster_cases import unpacked
from tools.code_aster_prism import KEPT, forces, reference, simulation

ADAPTER = CodeAsterAdapter()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    unpacked("prism.rmed", tmp_path, NODES)
    unpacked("prism_forces.csv", tmp_path, FORCES)
    unpacked("logs/prism_done.log", tmp_path, LISTING)
    return tmp_path


def asked() -> Simulation:
    return reference()[0]


def test_the_force_is_the_resultant_that_code_aster_tabulates(folder: Path) -> None:
    _, rows = forces()
    response = ADAPTER.read(asked(), folder)
    expected = [rows[abs(rows[:, 0] - instant).argmin(), 1] for instant in KEPT]
    np.testing.assert_allclose(response.force, expected, rtol=1e-6, atol=1e-6)


def test_the_prescribed_motion_comes_back_at_its_nodes(folder: Path) -> None:
    case = asked()
    case = replace(case, output_nodes=case.motion_nodes)
    found = ADAPTER.read(case, folder).displacement
    np.testing.assert_allclose(found, case.motion[case.output], atol=1e-12)


def test_a_response_has_no_derivatives_and_no_cells_unless_asked(folder: Path) -> None:
    response = ADAPTER.read(asked(), folder)
    assert response.d_force.shape == (0, 5) and response.cells is None
    with pytest.raises(ResultFileError, match="cells.rmed: no such file"):
        ADAPTER.read(replace(asked(), cell_fields=True), folder)


def test_the_steps_are_those_of_the_listing(folder: Path) -> None:
    response = ADAPTER.read(asked(), folder)
    assert (response.steps, response.cuts) == (45, 5)
    np.testing.assert_allclose(response.ends, forces()[0][1:], rtol=1e-9)


def test_a_listing_that_is_missing_or_tells_of_no_step_is_refused(folder: Path) -> None:
    (folder / LISTING).write_text("")
    with pytest.raises(ResultFileError, match="job.mess: found no time step"):
        ADAPTER.read(asked(), folder)
    (folder / LISTING).unlink()
    with pytest.raises(ResultFileError, match="job.mess: no such file; expected the listing"):
        ADAPTER.read(asked(), folder)


def test_forces_that_differ_in_two_files_are_refused(folder: Path) -> None:
    path = folder / FORCES
    text = path.read_text()
    assert text.count(" 1.05430043664836E+03") == 1
    path.write_text(text.replace(" 1.05430043664836E+03", " 1.05530043664836E+03"))
    with pytest.raises(ResultFileError) as error:
        ADAPTER.read(asked(), folder)
    assert str(error.value) == (
        f"{path}: found 1055.3 µN on S_PLUS at 10 s; expected 1054.3 µN, the sum of REAC_NODA in "
        "nodes.rmed"
    )


def test_an_instant_that_was_not_kept_is_named(folder: Path) -> None:
    times, _ = forces()
    with pytest.raises(ResultFileError, match="DEPL has 5 instants from 0 to 28 s; expected 0.357"):
        ADAPTER.read(simulation(times), folder)


def test_the_result_of_another_mesh_is_refused(folder: Path) -> None:
    case = asked()
    moved = replace(case, mesh=replace(case.mesh, points=case.mesh.points + 1e-3))
    with pytest.raises(ResultFileError, match="in other places than those of the simulation"):
        ADAPTER.read(moved, folder)
    fewer = replace(case, mesh=replace(case.mesh, cells=case.mesh.cells[1:]))
    with pytest.raises(ResultFileError, match="1381 nodes and 669 cells, expected the 1381 nodes"):
        ADAPTER.read(fewer, folder)
    mirrored = replace(case, mesh=replace(case.mesh, cells=case.mesh.cells[::-1]))
    with pytest.raises(ResultFileError, match="in other places"):
        ADAPTER.read(mirrored, folder)

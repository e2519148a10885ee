"""CalculiX run on small boxes beside the bundled solver, and the files of a real run read."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver_adapters.bundled.adapter import BundledAdapter
from solver_adapters.calculix.adapter import CalculixAdapter
from solver_adapters.crystal import FCC
from solver_adapters.external import Profile, Status
from solver_adapters.interface import Response, Simulation
from solver_adapters.jobs.errors import JobError
from solver_adapters.result_files import ResultFileError
from tests.solver_adapters.calculix.results import ASKED, DATA
from tests.solver_adapters.calculix.runs import (
    OCTAHEDRAL,
    largest,
    needs_ccx,
    run,
    simulation,
)
from tools.boxes import box, hex_box, pulled

LOADING = tuple(np.linspace(0.0, 0.002, 21)[1:])
"""Steps of 0.25 s at 4e-4 /s, through the onset of flow."""


def both(asked: Simulation, folder: Path) -> tuple[Response, Response]:
    """CalculiX, and the bundled solver at the steps that CalculiX took."""
    found = run(asked, folder)
    return found, BundledAdapter().solve(replace(asked, steps=found.ends))


def error(found: Response, expected: Response) -> float:
    return largest(found.force - expected.force) / largest(expected.force)


@needs_ccx
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"tau0_grain2": 1.15},
        {"Q": 50.0, "b": 30.0, "h_latent": -0.1},
        {"elastic_scale": 0.9, "C44_scale": 1.1},
        {"c": 0.0},
        {"K": 30.0, "n": 5.0, "d": 700.0},
    ],
    ids=lambda changes: "-".join(changes) or "null",
)
def test_each_term_of_the_law_is_that_of_the_bundled_solver(
    changes: dict[str, Any], tmp_path: Path
) -> None:
    """The point solution of CalculiX drops systems for good: hence not to the last digit."""
    found, expected = both(simulation(LOADING, 0.25, **changes), tmp_path)
    assert found.cuts == 0
    assert error(found, expected) < 1e-4
    assert largest(found.displacement - expected.displacement) < 1e-5  # µm


@needs_ccx
def test_fcc_is_what_the_systems_of_calculix_are(tmp_path: Path) -> None:
    """Copper: the octahedral systems are those of FCC without more ado."""
    copper: dict[str, Any] = {
        "C11": 168.4e3,
        "C12": 121.4e3,
        "C44": 75.4e3,
        "tau0": 20.0,
        "tau0_112": 1.0,
    }
    found, expected = both(simulation(LOADING, 0.25, slip_systems=FCC, **copper), tmp_path)
    assert found.cuts == 0
    assert error(found, expected) < 1e-4
    assert largest(found.displacement - expected.displacement) < 1e-5  # µm


@needs_ccx
def test_hardening_without_the_latent_part_of_calculix_is_another_law(tmp_path: Path) -> None:
    """Why Q is refused with h_latent = 0: half a percent of the force at 0.2 % of strain."""
    asked = simulation(LOADING, 0.25, Q=50.0, b=30.0, h_latent=-0.1)
    found, same = both(asked, tmp_path)
    other = replace(asked, material=replace(asked.material, h_latent=0.0), steps=found.ends)
    assert error(found, same) < 1e-4
    assert error(found, BundledAdapter().solve(other)) > 4e-3


@needs_ccx
def test_hexahedra_answer_as_in_the_bundled_solver(tmp_path: Path) -> None:
    """C3D20R has the eight points of prismid."""
    found, expected = both(simulation(LOADING, 0.25, mesh=hex_box()), tmp_path)
    assert error(found, expected) < 1e-4
    assert largest(found.displacement - expected.displacement) < 1e-5  # µm


@needs_ccx
def test_a_cycle_with_holds_is_followed(tmp_path: Path) -> None:
    strains = (0.001, 0.002, 0.002, 0.002, 0.0015, 0.001, 0.0, -0.0005, -0.0005, 0.0005)
    found, expected = both(simulation(strains, 2.0, steps=4), tmp_path)
    assert error(found, expected) < 1e-3


@needs_ccx
def test_components_without_motion_are_free(tmp_path: Path) -> None:
    asked = simulation(LOADING, 0.25)
    mask = asked.motion_mask.copy()
    low = len(asked.mesh.nodes["S_MINUS"])
    mask[low:, ::2] = False
    found, expected = both(replace(asked, motion_mask=mask), tmp_path)
    assert largest(expected.displacement[:, asked.mesh.nodes["S_PLUS"]][:, :, ::2]) > 1e-4
    assert error(found, expected) < 1e-4
    assert largest(found.displacement - expected.displacement) < 1e-5  # µm


@needs_ccx
def test_outputs_come_in_the_order_and_at_the_nodes_that_are_asked_for(tmp_path: Path) -> None:
    asked = simulation((0.0003, 0.0006, 0.0009, 0.0009))
    whole = run(asked, tmp_path)
    part = replace(asked, output=np.array([0, 2, 4]), output_nodes=np.array([30, 4, 12]))
    found = run(part, tmp_path)
    assert largest(whole.force) > 100
    np.testing.assert_array_equal(found.force, whole.force[[0, 2, 4]])
    expected = whole.displacement[[0, 2, 4]][:, [30, 4, 12]]
    np.testing.assert_array_equal(found.displacement, expected)
    none = replace(part, output_nodes=np.arange(0))
    assert run(none, tmp_path).displacement.shape == (3, 0, 3)


@needs_ccx
def test_steps_of_an_earlier_response_are_taken_again(tmp_path: Path) -> None:
    """One step an interval is too much here: CalculiX cuts it, and can be told the cut steps."""
    asked = simulation((0.002, 0.004, 0.006, 0.01), 5.0)
    first = run(asked, tmp_path)
    again = run(replace(asked, steps=first.ends), tmp_path)
    assert first.cuts > 0
    assert again.cuts == 0
    np.testing.assert_allclose(again.ends, first.ends, rtol=1e-6)


@needs_ccx
@pytest.mark.parametrize("steps", [1, 5])
def test_steps_are_no_longer_than_the_simulation_says(steps: int, tmp_path: Path) -> None:
    found = run(simulation((0.0002, 0.0004), 3.0, steps=steps), tmp_path)
    expected = np.linspace(0.0, 6.0, 2 * steps + 1)[1:]
    np.testing.assert_allclose(found.ends, expected, rtol=1e-6)


@needs_ccx
def test_a_motion_that_no_crystal_can_follow_is_diagnosed(tmp_path: Path) -> None:
    with pytest.raises(JobError) as error:
        run(simulation((100.0,), 1e-6), tmp_path)
    assert error.value.status is Status.NOT_CONVERGED


@needs_ccx
def test_a_run_that_ended_says_so(tmp_path: Path) -> None:
    run(simulation((1e-5,)), tmp_path)
    (printed,) = tmp_path.glob("*/stdout.txt")
    assert "Job finished" in printed.read_text()


def test_the_threads_are_in_the_environment_of_the_call() -> None:
    adapter = CalculixAdapter(Profile(threads=3))
    found = adapter.command(("/usr/bin/ccx",))
    assert found == ("/usr/bin/ccx", "-i", "job")
    assert adapter.environment()["OMP_NUM_THREADS"] == "3"


def test_the_first_instant_needs_no_file_of_displacements(tmp_path: Path) -> None:
    asked = replace(pulled(box(), OCTAHEDRAL, (1e-5,)), output=np.array([0]))
    status = " 1          1     1     2  0.100000E+01  0.100000E+01  0.100000E+01\n"
    (tmp_path / "job.sta").write_text(f"SUMMARY OF JOB INFORMATION\n {status}")
    found = CalculixAdapter().read(asked, tmp_path)
    assert found.force.tolist() == [0.0]
    assert not found.displacement.any()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for kind in ("dat", "sta"):
        shutil.copy(DATA / f"job.{kind}", tmp_path)
    return tmp_path


def test_a_real_run_is_read_whole(folder: Path) -> None:
    found = CalculixAdapter().read(ASKED, folder)
    low, high = ASKED.mesh.nodes["S_MINUS"], ASKED.mesh.nodes["S_PLUS"]
    assert not found.displacement[:, low].any()
    # The strains 0.01, 0.01, 0.006 of 4 µm; seven digits are in the file.
    motion = np.array([0.0, 0.04, 0.04, 0.024])[:, None]
    np.testing.assert_allclose(found.displacement[:, high, 1], motion + 0 * high, rtol=1e-6)
    assert found.force[0] == 0.0
    assert found.force[1] > found.force[2] > 0 > found.force[3]
    assert found.steps == len(found.ends)
    assert found.ends[-1] == 6.0
    assert set(ASKED.times[1:]) <= set(found.ends)


def test_what_is_read_agrees_with_the_bundled_solver_at_the_steps_that_are_read(
    folder: Path,
) -> None:
    """Steps this large show CalculiX's own error, most where a hold is one step (row 2)."""
    found = CalculixAdapter().read(ASKED, folder)
    expected = BundledAdapter().solve(replace(ASKED, steps=found.ends))
    error = abs(found.force - expected.force) / abs(expected.force).max()
    assert error[[1, 3]].max() < 6e-3
    assert error[2] < 3e-2


def refusal(folder: Path) -> str:
    with pytest.raises(ResultFileError) as error:
        CalculixAdapter().read(ASKED, folder)
    message = str(error.value)
    assert "found" in message
    assert "expected" in message
    assert "\n" not in message
    return message


@pytest.mark.parametrize("kind", ["dat", "sta"])
@pytest.mark.parametrize(
    ("spoil", "word"),
    [
        (lambda path: path.unlink(), "no such file"),
        (lambda path: path.write_text(""), "empty"),
        (lambda path: path.write_bytes(b"\x89HDF\r\n\x1a\n\xff\x00 foreign"), ""),
        (lambda path: path.write_text(path.read_text()[: len(path.read_text()) * 6 // 10]), ""),
    ],
    ids=["missing", "empty", "foreign", "truncated"],
)
def test_a_spoilt_file_is_named_in_one_sentence(
    kind: str, spoil: Callable[[Path], object], word: str, folder: Path
) -> None:
    spoil(folder / f"job.{kind}")
    message = refusal(folder)
    assert message.startswith(f"job.{kind}: ")
    assert word in message


def _later(simulation: Simulation) -> Simulation:
    return replace(simulation, times=simulation.times + 100.0)


def test_instants_count_from_the_first_one_of_the_simulation(folder: Path) -> None:
    found = CalculixAdapter().read(_later(ASKED), folder)
    assert found.ends[-1] == 106.0
    np.testing.assert_array_equal(found.force, CalculixAdapter().read(ASKED, folder).force)

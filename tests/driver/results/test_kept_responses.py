from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from driver.common.progress import progress_to
from driver.results import kept_responses
from driver.results.kept_responses import KeptResponses, keeping
from solver_adapters.interface import (
    Capabilities,
    CellFields,
    Progress,
    Response,
    Simulation,
    Trajectory,
)
from tools import closed_form

SIMULATION = closed_form.problem().model.simulation(closed_form.problem().truth, ("tau0", "c"))


class Whole(closed_form.ClosedFormSolver):
    """The solver in closed form, whose answers have all that an answer can have."""

    runs = 0

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        self.runs += 1
        found = super().solve(simulation, workspace, progress)
        rng, n = np.random.default_rng(self.runs), found.force.size
        cells = CellFields(*(rng.random((n, 2, width)) for width in (6, 24, 24, 3)))
        course = Trajectory(np.arange(3.0), rng.random((5, 3, 3)).swapaxes(0, 1))
        return replace(
            found, steps=7, iterations=11, cuts=1, refinements=2, seconds={"law": 0.1 + 0.2},
            notes=("τ₀ is low", ""), cells=cells, trajectory=course,
            displacement=np.asfortranarray(found.displacement),
        )  # fmt: skip


def alike(first: Response, second: Response) -> bool:
    """Whether all is the same, the order of the arrays in memory as well."""

    def same(a: object, b: object) -> bool:
        if isinstance(a, np.ndarray) and isinstance(b, np.ndarray):
            return a.tobytes() == b.tobytes() and (a.shape, a.strides) == (b.shape, b.strides)
        if isinstance(a, CellFields | Trajectory):
            return all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
        return a == b

    return all(same(getattr(first, f.name), getattr(second, f.name)) for f in fields(Response))


def test_what_is_taken_up_is_what_was_answered_to_the_last_bit(tmp_path: Path) -> None:
    solver = Whole()
    answered = KeptResponses(solver, tmp_path / "kept").solve(SIMULATION)
    again = KeptResponses(solver, tmp_path / "kept").solve(SIMULATION)
    assert solver.runs == 1 and alike(answered, again)


def test_every_field_of_a_response_is_kept() -> None:
    kept = {*kept_responses._ARRAYS, *kept_responses._COUNTS, *kept_responses._PARTS}
    assert kept | {"seconds", "notes"} == {item.name for item in fields(Response)}


def test_another_simulation_another_beginning_and_another_solver_are_made(tmp_path: Path) -> None:
    solver = Whole()
    adapter = KeptResponses(solver, tmp_path)
    course = Trajectory(np.arange(2.0), np.zeros((2, len(SIMULATION.mesh.points), 3)))
    other = replace(course, displacement=course.displacement + 1e-12)
    for simulation in (
        SIMULATION, replace(SIMULATION, tolerance=1e-6), replace(SIMULATION, warm_start=course),
        replace(SIMULATION, warm_start=other),
    ):  # fmt: skip
        adapter.solve(simulation)
    assert solver.runs == 4
    solver.version = lambda: "2"  # type: ignore[method-assign]
    adapter.solve(SIMULATION)
    assert solver.runs == 5


@pytest.mark.parametrize("at", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_damaged_file_is_told_and_made_anew(tmp_path: Path, at: float) -> None:
    solver, lines = Whole(), list[str]()
    adapter = KeptResponses(solver, tmp_path)
    first = adapter.solve(SIMULATION)
    (place,) = tmp_path.iterdir()
    whole = place.read_bytes()
    flipped = bytearray(whole)
    flipped[int(at * len(whole))] ^= 0xFF
    for content in (bytes(flipped), whole[: int(at * len(whole))]):
        place.write_bytes(content)
        before = solver.runs
        with progress_to(lines.append):
            again = adapter.solve(SIMULATION)
        # A byte of a table of the archive that nobody reads is no damage.
        assert alike(first, again) or solver.runs == before + 1
    assert lines[-1] == f"    {place}: a kept simulation is damaged: it is made anew"


def test_a_disk_that_takes_no_more_ends_no_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object, **arrays: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np, "savez", full)
    lines: list[str] = []
    with progress_to(lines.append):
        KeptResponses(Whole(), tmp_path / "kept").solve(SIMULATION)
    (told,) = lines
    assert told.startswith(f"    {tmp_path / 'kept'}: a simulation is not kept (")
    assert not list((tmp_path / "kept").iterdir())


def test_a_solver_with_a_store_of_its_own_is_left_alone_and_another_process_keeps_as_well(
    tmp_path: Path,
) -> None:
    class Program(closed_form.ClosedFormSolver):
        def capabilities(self) -> Capabilities:
            return replace(super().capabilities(), in_process=False)

    program, solver = Program(), closed_form.ClosedFormSolver()
    assert keeping(program, tmp_path) is program
    assert keeping(solver, None) is solver
    sent = pickle.loads(pickle.dumps(keeping(solver, tmp_path)))
    assert isinstance(sent, KeptResponses) and sent.folder == tmp_path

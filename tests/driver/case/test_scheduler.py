from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from driver.case import scheduler
from driver.case.consent import ConsentError
from driver.case.model import Case, load_case, write_case
from driver.case.scheduler import on_workers
from driver.check.command import check
from driver.common.errors import InputError
from driver.common.parallel import side_by_side
from driver.results.hdf5 import read_hdf5
from driver.virtual.command import virtual
from driver.workflow import pipeline
from tests.driver.batch.cases import write_small_case
from tests.support.dask_cluster import cluster

NOBODY = "tcp://127.0.0.1:1"


def case_with(folder: Path, address: str) -> Case:
    path = write_small_case(folder)
    write_case(load_case(path).with_values_at({"execution.scheduler": address}), path)
    return load_case(path)


def test_a_scheduler_is_refused_until_its_user_agrees(tmp_path: Path) -> None:
    case = case_with(tmp_path / "a", NOBODY)
    with pytest.raises(ConsentError, match=r"execution.scheduler: found a scheduler .*trust"):
        with on_workers(case):
            pass
    found = {f.subject: f for f in check(case.file)}["scheduler"]
    assert found.level == "error" and "you have not agreed to" in found.message


@pytest.mark.usefixtures("willing")
def test_a_scheduler_that_does_not_answer_is_told_by_run_and_check(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(scheduler, "_PATIENCE", 1)
    case = case_with(tmp_path / "a", NOBODY)
    told = "execution.scheduler: found .* expected the address of a Dask scheduler that answers"
    with pytest.raises(InputError, match=told):
        pipeline.run(case.file, "mesh")
    found = {f.subject: f for f in check(case.file)}["scheduler"]
    assert found.level == "error" and NOBODY in found.message


def test_without_a_scheduler_processes_of_this_machine_do_the_tasks(tmp_path: Path) -> None:
    with on_workers(load_case(write_small_case(tmp_path / "a"))):
        assert side_by_side(abs, [-1, 2], 2) == [1, 2]


class Client:
    """Of a scheduler that this process plays."""

    def __init__(self, executor: Executor) -> None:
        self.executor = executor

    def get_executor(self, pure: bool) -> Executor:
        return self.executor


class KilledWorker(Exception):
    """As Dask tells of a task whose workers all died."""

    allowed_failures = 3


def lost(_: int) -> None:
    raise CancelledError


def killed(_: int) -> None:
    raise KilledWorker


@pytest.mark.usefixtures("willing")
@pytest.mark.parametrize(
    ("work", "told"),
    [
        (lost, f"found tasks on the workers of {NOBODY} lost, expected a scheduler that lives"),
        (killed, "found a task that was lost with each worker that was at work on it, 4 in all"),
    ],
)
def test_what_a_cluster_loses_is_told_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, work: Any, told: str
) -> None:
    @contextmanager
    def played(address: str, file: Path) -> Iterator[Client]:
        with ThreadPoolExecutor(2) as threads:
            yield Client(threads)

    monkeypatch.setattr(scheduler, "client_of", played)
    case = case_with(tmp_path / "a", NOBODY)
    with pytest.raises(InputError, match=told), on_workers(case):
        side_by_side(work, [1, 2], 2)


@pytest.mark.slow
@pytest.mark.usefixtures("willing")
def test_starts_on_workers_of_a_scheduler_end_with_the_numbers_of_processes_here(
    tmp_path: Path, lines: list[str]
) -> None:
    base = write_small_case(tmp_path / "base")
    few = {"identification.starts": 3, "identification.max_iterations": 1}
    write_case(load_case(base).with_values_at(few), base)
    (tmp_path / "s.toml").write_text(
        "[program]\ncycles = [[3, 1]]\nlargest_strain = 0.005\n[discretisation]\n"
        "mesh_size_um = 0.9\n"
    )
    virtual(base, tmp_path / "s.toml", tmp_path / "data", 1)
    path = tmp_path / "data" / "case.toml"
    pipeline.run(path, "identify", results=tmp_path / "here")
    with cluster(tmp_path, 2) as made:
        named = {"execution.scheduler": made.address}
        write_case(load_case(path).with_values_at(named), path)
        (told,) = [f.message for f in check(path) if f.subject == "scheduler"]
        assert told.startswith(f"{made.address}: 2 worker(s), 2 thread(s)")
        before = [worker.cpu_times().user for worker in made.processes]
        pipeline.run(path, "identify", results=tmp_path / "there")
        after = [worker.cpu_times().user for worker in made.processes]
        # What is done and unchanged is not done again for another place to compute.
        del lines[:]
        pipeline.run(path, "identify", results=tmp_path / "here")
    assert any("done and unchanged" in line for line in lines)
    assert all(late > early + 1 for early, late in zip(before, after, strict=True))
    one, other = (read_hdf5(tmp_path / name / "identify.h5") for name in ("here", "there"))
    assert one.keys() == other.keys()
    for name, values in one.items():
        np.testing.assert_array_equal(other[name], values, err_msg=name)

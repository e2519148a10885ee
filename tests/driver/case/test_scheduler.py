from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor, ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from driver.case import scheduler
from driver.case.consent import ConsentError
from driver.case.model import Case, load_case, write_case
from driver.case.scheduler import on_workers
from driver.check.command import check
from driver.common.errors import InputError
from driver.common.parallel import side_by_side
from driver.workflow import pipeline
from tests.driver.batch.cases import write_small_case

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

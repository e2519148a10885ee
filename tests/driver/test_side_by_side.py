from __future__ import annotations

import math
import os

import pytest

from driver.side_by_side import side_by_side


@pytest.mark.parametrize("processes", [1, 2])
def test_results_come_in_the_order_of_the_tasks(processes: int) -> None:
    ended: dict[int, float] = {}
    found = side_by_side(
        math.sqrt, [9.0, 4.0, 1.0, 16.0], processes, done=lambda i, root: ended.update({i: root})
    )
    assert found == [3.0, 2.0, 1.0, 4.0]
    assert ended == {0: 3.0, 1: 2.0, 2: 1.0, 3: 4.0}


@pytest.mark.parametrize("processes", [1, 2])
def test_a_failing_task_fails_the_whole(processes: int) -> None:
    with pytest.raises(ValueError):
        side_by_side(math.sqrt, [4.0, -1.0, 9.0], processes)


def test_each_process_has_its_threads_and_this_one_keeps_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS"]
    assert side_by_side(os.getenv, names, 2, threads=1) == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7" and "MKL_NUM_THREADS" not in os.environ


def test_more_threads_than_the_machine_has_are_as_many_as_it_has() -> None:
    assert side_by_side(math.sqrt, [4.0, 9.0], 2, threads=4096) == [2.0, 3.0]


def test_no_tasks_have_no_results() -> None:
    assert side_by_side(math.sqrt, [], 4) == []

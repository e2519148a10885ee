from __future__ import annotations

import os
from pathlib import Path

import pytest

from driver.common.machine import cores, memory


def test_cores_are_those_that_the_process_may_run_on() -> None:
    before = os.sched_getaffinity(0)
    assert cores() == len(before)
    try:
        os.sched_setaffinity(0, {min(before)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, before)


@pytest.mark.parametrize(("text", "share"), [("max\n", 1.0), ("1000000\n", None), (None, 1.0)])
def test_memory_is_that_of_the_control_group_where_it_has_a_limit(
    tmp_path: Path, text: str | None, share: float | None
) -> None:
    whole = float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    file = tmp_path / "memory.max"
    if text is not None:
        file.write_text(text)
    assert memory(file) == (1e6 if share is None else whole)

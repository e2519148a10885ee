"""A process has another one compile what it calls, in real processes with a cache of their own."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import psutil
import pytest
from numba.core.errors import TypingError

from driver.dic.patterns import summed_dense

PROGRAM = """
import json, os, sys
import numpy as np, psutil
from numba.core.event import RecordingListener, register
from solver_adapters import kernels
from driver.dic.patterns import summed_dense, summed_sparse

own = RecordingListener()
register("numba:compile", own)
blocks, dofs = np.array([[1.0, 2.0, 3.0]]), np.array([[0, 1]])
told = {"before": kernels.compiled_before(), "sum": summed_dense(blocks, dofs, 2).tolist()}
there = psutil.Process().children()
if "kill" in sys.argv:
    there[0].kill()
    there[0].wait()
told["sparse"] = summed_sparse(blocks, dofs, 2)[0].tolist()
told["own"] = len(own.buffer)
told["others"] = [process.pid for process in psutil.Process().children()]
print(json.dumps(told), flush=True)
if "die" in sys.argv:
    os.kill(os.getpid(), 9)
"""


def told(cache: Path, *words: str, before: Callable[[], None] | None = None) -> dict[str, Any]:
    """What a new process says that sums with kernels of this cache."""
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM, *words],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        stdout=subprocess.PIPE,
        timeout=120,
        check=False,
        preexec_fn=before,
    )
    answer: dict[str, Any] = json.loads(ended.stdout)
    assert answer["sum"] == [[1.0, 2.0], [2.0, 3.0]] and answer["sparse"] == [1.0, 2.0, 2.0, 3.0]
    return answer


def test_a_process_loads_what_another_one_compiles_that_ends_with_it_even_where_it_is_killed(
    tmp_path: Path,
) -> None:
    first = told(tmp_path, "die")
    assert not first["before"] and first["own"] == 0
    (other,) = first["others"]
    with suppress(psutil.NoSuchProcess):
        psutil.Process(other).wait(5.0)
    later = told(tmp_path)
    assert later["before"] and later["own"] == 0 and later["others"] == []


def test_so_it_does_where_all_streams_but_its_output_are_closed(tmp_path: Path) -> None:
    def closed() -> None:
        os.close(0)
        os.close(2)

    assert told(tmp_path, before=closed)["own"] == 0


def test_another_process_compiles_after_one_that_was_killed(tmp_path: Path) -> None:
    assert told(tmp_path, "kill")["own"] == 0


def test_a_kernel_that_cannot_be_compiled_is_told_where_it_is_called() -> None:
    with pytest.raises(TypingError):
        summed_dense("no array", 1.0, 2)

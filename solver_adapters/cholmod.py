"""CHOLMOD of cvxopt, by the kernels of OpenBLAS that suit the processor.

The OpenBLAS in the wheels of cvxopt is of 2021. A processor that is younger is a Pentium 4 to it,
of SSE3 (`Prescott`), unless the environment names another one: factors took 1.7 times as long.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CORE = "OPENBLAS_CORETYPE"
"""Variable of the environment by which OpenBLAS, while it is loaded, is told the processor."""
PROCESSOR = Path("/proc/cpuinfo")


@contextmanager
def core_told(cpuinfo: Path) -> Iterator[None]:
    """Tell OpenBLAS a processor with AVX2 where this one has it, unless the user told one.

    Args:
        cpuinfo: what Linux says of the processor; elsewhere there is none.
    """
    if CORE in os.environ or not has_avx2(cpuinfo):
        yield
        return
    os.environ[CORE] = "Haswell"
    try:
        yield
    finally:
        del os.environ[CORE]  # Other libraries have newer ones, which know it.


def has_avx2(cpuinfo: Path) -> bool:
    """Whether a file of the form of /proc/cpuinfo tells of AVX2 and fused multiplication."""
    try:
        lines = cpuinfo.read_text("utf-8").splitlines()
    except OSError:
        return False
    flags = next((line.split() for line in lines if line.startswith("flags")), [])
    return {"avx2", "fma"} <= {*flags}


with core_told(PROCESSOR):
    from cvxopt import cholmod, matrix, sparse, spmatrix

__all__ = ["cholmod", "core_told", "has_avx2", "matrix", "sparse", "spmatrix"]

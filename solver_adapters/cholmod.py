"""CHOLMOD of cvxopt, with the kernels of OpenBLAS that suit the processor.

The OpenBLAS in the wheels of cvxopt is of 2021. A processor that it does not know gets the kernels
of SSE3 (`Prescott`). Factors of large meshes then take 1.7 times as long (benchmarks/numerics.md).
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CORE = "OPENBLAS_CORETYPE"
"""Variable of the environment by which OpenBLAS, while it is loaded, is told the processor."""
PROCESSOR = Path("/proc/cpuinfo")
"""What Linux says of the processor."""
_NEEDED = {
    "SkylakeX": {"avx512f", "avx512cd", "avx512bw", "avx512dq", "avx512vl"},
    "Haswell": {"avx2", "fma"},
}
"""Flags of processors, the one with the widest vectors first."""


@contextmanager
def core_type_set(cpuinfo: Path) -> Iterator[None]:
    """Tell OpenBLAS a processor of the same instructions, unless the user told one.

    Args:
        cpuinfo: what Linux says of the processor; elsewhere there is none.
    """
    core = None if CORE in os.environ else core_of(cpuinfo)
    if core is None:
        yield
        return
    os.environ[CORE] = core
    try:
        yield
    finally:
        del os.environ[CORE]  # Other libraries have newer ones, which know it.


def core_of(cpuinfo: Path) -> str | None:
    """Return a processor that OpenBLAS of 2021 knows, by a file of the form of /proc/cpuinfo.

    Returns:
        One with the widest vectors that this one has; None without AVX2, or where nothing is told.
    """
    try:
        lines = cpuinfo.read_text("utf-8", "replace").splitlines()
    except OSError:
        return None
    flags = {*next((line.split() for line in lines if line.startswith("flags")), [])}
    return next((core for core, needed in _NEEDED.items() if needed <= flags), None)


with core_type_set(PROCESSOR):
    from cvxopt import cholmod, matrix, sparse, spmatrix

__all__ = [
    "CORE", "PROCESSOR", "cholmod", "core_of", "core_type_set", "matrix", "sparse", "spmatrix",
]  # fmt: skip

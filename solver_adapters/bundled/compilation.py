"""How kernels are compiled: one decorator, and a cache on disk keyed on all kernel sources.

Numba keys its cache on the file of a function and does not notice a changed callee in another
file, nor changed arrays that were frozen into it: the folder below carries a hash of all sources.
"""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

# GNU's OpenMP threads spin while they wait: on a machine with other work that makes every parallel
# loop ten times slower. It must be said before the first loop loads the library.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numba  # noqa: E402

_FAST = {"contract", "reassoc", "nsz", "arcp", "nnan"}


def sources_hash() -> str:
    """Hash of every source that the solver's answer depends on, and of Numba's version."""
    here = Path(__file__).parent
    beside = (
        here.parent / name
        for name in ("crystal.py", "interaction.py", "material.py", "time_steps.py")
    )
    meshes = here.parents[1] / "meshes"
    cells = (meshes / name for name in ("cells.py", "tet10.py", "wedge15.py"))
    digest = hashlib.sha256(numba.__version__.encode())
    for source in (*sorted(here.glob("*.py")), *beside, *cells):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "prismid" / f"kernels-{sources_hash()}"


_config: Any = numba.config
_config.CACHE_DIR = str(_cache_folder())


def kernel(function: Any) -> Any:
    """Compile a scalar kernel that is inlined into the batch loops by LLVM."""
    return numba.njit(
        cache=True,
        error_model="numpy",
        fastmath=_FAST,
        nogil=True,
    )(function)


def ordered_kernel(function: Any) -> Any:
    """Compile a scalar kernel whose sums keep their order, as cancelled digits demand."""
    return numba.njit(cache=True, error_model="numpy", fastmath={"contract"}, nogil=True)(function)


def batch_kernel(function: Any) -> Any:
    """Compile a loop over Gauss points or elements that Numba spreads over threads."""
    return numba.njit(cache=True, error_model="numpy", fastmath=_FAST, nogil=True, parallel=True)(
        function
    )


def use_threads(count: int) -> None:
    """Let the parallel loops of this process run on `count` threads, no more than there are."""
    numba.set_num_threads(min(count, int(_config.NUMBA_NUM_THREADS)))

"""How kernels are compiled: one decorator, and a cache on disk keyed on all kernel sources.

Numba keys its cache on the file of a function and does not notice a changed callee in another
file; the folder below therefore carries a hash of every source in this package.
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


def _sources_hash() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path:
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "prismid" / f"kernels-{_sources_hash()}"


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

"""How kernels are compiled: one decorator, and a cache on disk keyed on all kernel sources.

Numba keys its cache on the file of a function and does not notice a changed callee in another
file, nor changed arrays that were frozen into it: the folder below carries a hash of all that. Nor
does it notice that a file is loaded under two names (`bundled.law.of_48`): those of a module that
is not called as its file lies have a folder of their own within it.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, wraps
from pathlib import Path
from typing import Any

import numba
from numba.core.event import Event, Listener, register

from solver_adapters.compiling_process import found_elsewhere, made_by
from solver_adapters.user_folders import cache_folder

# GNU's OpenMP threads spin while they wait: on a machine with other work that makes every parallel
# loop ten times slower. It must be said before the first loop loads the library.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

_FAST = {"contract", "reassoc", "nsz", "arcp", "nnan"}
PACKAGES = Path(__file__).parents[1]

# Where kernels stand, and what they freeze: constants, layouts, tables.
KERNEL_SOURCES = (
    *(
        f"solver_adapters/bundled/law/{name}.py"
        for name in (
            "__init__",
            "back_strain",
            "constant_derivatives",
            "fast_math",
            "finite_derivative",
            "finite_strain",
            "law",
            "law_terms",
            "of_48/__init__",
            "point_kernels",
            "relaxation",
            "simd_rows",
            "slip",
            "slip_derivatives",
            "state_layout",
            "small_derivative",
            "small_lu",
            "small_strain",
            "tensors",
            "workspace_layout",
        )
    ),
    "solver_adapters/bundled/fem/assembly.py",
    "solver_adapters/bundled/fem/dilatation.py",
    *(
        f"solver_adapters/{name}.py"
        for name in (
            "kernels",
            "compiling_process",
            "user_folders",
            "constants",
            "crystal",
            "grain_scalars",
            "material",
            "parameter",
        )
    ),
)


def hash_of(sources: Iterable[Path], versions: Mapping[str, str]) -> str:
    """16 hexadecimal digits that change with a source or the version of a library."""
    digest = hashlib.sha256(repr(sorted(versions.items())).encode())
    for source in sources:
        digest.update(source.read_bytes())
    return digest.hexdigest()[:16]


def kernels_hash(packages: Path = PACKAGES) -> str:
    """Hash of what the compiled kernels come from, in the folder that holds `solver_adapters`."""
    sources = (packages / name for name in KERNEL_SOURCES)
    return hash_of(sources, {"numba": numba.__version__})


def kernels_folder() -> Path | None:
    """Return the folder of the compiled kernels, or None where none can be written."""
    root = cache_folder(os.environ.get("NUMBA_CACHE_DIR"))
    return None if root is None else root / f"kernels-{kernels_hash()}"


_config: Any = numba.config
_folder = kernels_folder()
if _folder is not None:
    _config.CACHE_DIR = str(_folder)


def compiled_before() -> bool:
    """Whether kernels of this version were compiled on this machine before."""
    folder = kernels_folder()
    return folder is not None and any(folder.rglob("*.nbi"))


class _Compilations(Listener):
    """Counts the kernels that are being compiled; those that are loaded are none."""

    def __init__(self) -> None:
        self.at_work = self.begun = 0

    def on_start(self, event: Event) -> None:
        """Count one that begins."""
        self.at_work += 1
        self.begun += 1

    def on_end(self, event: Event) -> None:
        """Count one that ends."""
        self.at_work -= 1

    @contextmanager
    def one_more(self) -> Iterator[None]:
        """Count one that another process makes for this one."""
        self.at_work += 1
        self.begun += 1
        try:
            yield
        finally:
            self.at_work -= 1


_compilations = _Compilations()
_register: Any = register
_register("numba:compile", _compilations)


def compiling() -> bool:
    """Whether this process compiles a kernel just now, or has one compiled."""
    return _compilations.at_work > 0


def compilations() -> int:
    """How many kernels this process has begun to compile, or had compiled."""
    return _compilations.begun


def compiled(**options: Any) -> Callable[[Any], Any]:
    """Return what compiles a function and keeps the result, where there is a folder for it.

    Args:
        options: of `numba.njit`.
    """

    def compile_lazily(function: Any) -> Any:
        if _folder is None or _config.DISABLE_JIT:
            return numba.njit(**options)(function)
        with _decorating, _in_folder_of(function, _folder):
            dispatcher = numba.njit(cache=True, **options)(function)
        return found_elsewhere(dispatcher, _compilations.one_more)

    return compile_lazily


_decorating = threading.Lock()


@contextmanager
def _in_folder_of(function: Any, folder: Path) -> Iterator[None]:
    """Let Numba cache a function where no other module of the same file has its own."""
    package = function.__module__.rpartition(".")[0].rpartition(".")[2]
    if package in ("", Path(function.__code__.co_filename).parent.name):
        yield
        return
    before, _config.CACHE_DIR = _config.CACHE_DIR, str(folder / package)
    try:
        yield
    finally:
        _config.CACHE_DIR = before


# What Python and C would call a kernel by: a fourth of the time of its compilation.
_FOR_KERNELS_ONLY = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def kernel(function: Any) -> Any:
    """Compile a scalar kernel that is inlined into the batch loops by LLVM.

    Only other kernels can call it: a call from Python ends the process.
    """
    options = {"error_model": "numpy", "fastmath": _FAST, **_FOR_KERNELS_ONLY}
    return compiled(**options)(function)


def ordered_kernel(function: Any) -> Any:
    """Compile a scalar kernel whose sums keep their order, as cancelled digits demand.

    As with `kernel`, only other kernels can call it.
    """
    options = {"error_model": "numpy", "fastmath": {"contract"}, **_FOR_KERNELS_ONLY}
    return compiled(**options)(function)


def loop_kernel(function: Any) -> Any:
    """Compile a loop that Python calls and that runs on one thread."""
    return compiled(error_model="numpy", fastmath=_FAST, nogil=True)(function)


def batch_kernel(function: Any) -> Any:
    """Compile a loop over Gauss points or elements that Numba spreads over threads."""
    return compiled(error_model="numpy", fastmath=_FAST, nogil=True, parallel=True)(function)


def kernels_for(factory: Callable[..., Any]) -> Callable[..., Any]:
    """Return a factory of kernels for given numbers that makes each once."""

    @cache
    @wraps(factory)
    def made(*numbers: int) -> Any:
        dispatcher = factory(*numbers)
        made_by(dispatcher, factory, numbers)
        return dispatcher

    return made


def use_threads(count: int) -> None:
    """Let the parallel loops of this process run on `count` threads, no more than there are."""
    numba.set_num_threads(min(count, int(_config.NUMBA_NUM_THREADS)))

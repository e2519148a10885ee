"""The gmsh module, imported with the system libraries that its wheel does not bring along."""

from __future__ import annotations

import ctypes
import importlib
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType

from meshes.kept_signals import signals_kept
from meshes.system_libraries import SystemLibraryError, preload, private_folder


def load_gmsh() -> ModuleType:
    """Import gmsh after the libraries that the set-up unpacked into the virtual environment.

    Returns:
        The module `gmsh`, not yet initialised.

    Raises:
        SystemLibraryError: a shared library is missing; the message names it and the remedy.
    """
    preload(private_folder())
    try:
        return importlib.import_module("gmsh")
    except OSError as error:
        # The loader says "libX.so.1: cannot open shared object file: …".
        raise SystemLibraryError([str(error).partition(":")[0]]) from error


@contextmanager
def running_gmsh() -> Iterator[ModuleType]:
    """Return the module `gmsh`, initialised inside, in whatever thread; signals stay as set.

    Raises:
        SystemLibraryError: as `load_gmsh`.
    """
    gmsh = load_gmsh()
    # Without interruptible=False gmsh takes over SIGINT, and only the main thread may do that.
    # These it gives their default in any case: a child that ends, or the end of a terminal that is
    # to be ignored, would end this process, too.
    library = ctypes.CDLL(None)
    library.signal.argtypes = (ctypes.c_int, ctypes.c_void_p)
    defaulted = (signal.SIGPIPE, signal.SIGTERM, signal.SIGHUP)
    with signals_kept(defaulted):
        for each in defaulted:
            library.signal(each, int(signal.SIG_IGN))
        gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        yield gmsh
    finally:
        gmsh.finalize()

"""The gmsh module, imported with the system libraries that its wheel does not bring along."""

from __future__ import annotations

import importlib
from types import ModuleType

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

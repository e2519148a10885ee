"""Loads matplotlib, with nothing of the folder of the call and without a home if there is none."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager, nullcontext
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

from solver_adapters.user_folders import cache_folder, can_keep

_FOLDER = "MPLCONFIGDIR"
_SETTINGS = "matplotlibrc"  # what matplotlib reads first, from the folder of the call


def load() -> None:
    """Import matplotlib, which decides now what it reads and where it keeps its fonts."""
    found = find_spec("matplotlib")
    folder = next(iter(found.submodule_search_locations or ()), "") if found else ""
    elsewhere = chdir(folder) if folder and os.path.exists(_SETTINGS) else nullcontext()
    with elsewhere, _folder_to_keep():
        import_module("matplotlib.font_manager")


@contextmanager
def _folder_to_keep() -> Iterator[None]:
    """Name a folder inside, where the user has none that can be written and names none."""
    cache = None
    if not os.environ.get(_FOLDER) and not can_keep("matplotlib"):
        cache = cache_folder()
    if cache is None:
        yield
        return
    os.environ[_FOLDER] = str(Path(cache, "matplotlib"))
    try:
        yield
    finally:
        del os.environ[_FOLDER]


load()

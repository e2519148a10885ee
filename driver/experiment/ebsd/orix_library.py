"""The library orix beside the kernels: both are compiled by Numba, and kept on disk."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numba


@contextmanager
def compiled_apart() -> Iterator[None]:
    """Let a library that is first imported here keep its compiled functions beside its own files.

    The folder of the kernels is another one for each version of these, and whether it is empty
    tells whether they were compiled before. Orix compiles for a minute.
    """
    config: Any = numba.config
    of_kernels, config.CACHE_DIR = config.CACHE_DIR, ""
    try:
        yield
    finally:
        config.CACHE_DIR = of_kernels

"""The hash that tells simulations apart, the same on every machine."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from solver_adapters.interface import Simulation


def simulation_key(simulation: Simulation, version: str) -> str:
    """SHA-256 of a simulation, little-endian, and of the solver that runs it.

    How the iterations begin is no part of it.
    """
    digest = hashlib.sha256(version.encode())
    for item in fields(simulation):
        if item.name != "warm_start":
            _feed_field(digest, simulation, item.name)
    return digest.hexdigest()


def _feed(digest: Any, value: Any) -> None:
    if is_dataclass(value):
        for item in fields(value):
            _feed_field(digest, value, item.name)
    elif isinstance(value, np.ndarray):
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        digest.update(f"{little.dtype.str}{little.shape}".encode())
        digest.update(little.tobytes())
    elif isinstance(value, Mapping):
        for key in sorted(value):
            digest.update(str(key).encode())
            _feed(digest, value[key])
    elif isinstance(value, tuple):
        digest.update(str(len(value)).encode())
        for part in value:
            _feed(digest, part)
    else:
        plain = value.item() if isinstance(value, np.generic) else value
        digest.update(repr(plain).encode())


def _feed_field(digest: Any, value: Any, name: str) -> None:
    digest.update(name.encode())
    _feed(digest, getattr(value, name))

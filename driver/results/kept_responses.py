"""Responses of a stage that is at work, kept so that an interruption does not lose them."""

from __future__ import annotations

import hashlib
import json
import logging
import os
from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from driver.common.errors import why
from driver.results.files import kept_response
from solver_adapters.interface import (
    Adapter,
    Capabilities,
    CellFields,
    Progress,
    Response,
    Simulation,
    Trajectory,
)
from solver_adapters.simulation_key import simulation_key

logger = logging.getLogger(__name__)

_COUNTS = ("steps", "iterations", "cuts", "refinements")
_ARRAYS = ("displacement", "force", "d_displacement", "d_force", "ends")
_PARTS = {"cells": CellFields, "trajectory": Trajectory}


class KeptResponses:
    """An adapter that keeps its responses in a folder, and takes up those that are there.

    A response is found by the hash of all that it depends on: the simulation, how its iterations
    begin, and the identity of the solver. What is read is what was written, to the last bit.

    Attributes:
        inner: the solver.
        name: that of the solver.
        folder: where the responses are kept; it is made with the first of them.
    """

    def __init__(self, inner: Adapter, folder: Path) -> None:
        self.inner, self.name, self.folder = inner, inner.name, folder

    def capabilities(self) -> Capabilities:
        """Return what the solver can honour."""
        return self.inner.capabilities()

    def version(self) -> str:
        """Identity of the solver."""
        return self.inner.version()

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run a simulation that is not kept; what it raises is what the solver raises."""
        place = kept_response(self.folder, _key(simulation, self.inner))
        kept = _read(place)
        if kept is not None:
            logger.info("    a simulation that was made before is taken up")
            return kept
        response = _in_order(self.inner.solve(simulation, workspace, progress))
        _keep(place, response)
        return response


def keeping(adapter: Adapter, folder: Path | None) -> Adapter:
    """Return an adapter that keeps its responses, where it has no store of its own.

    Args:
        adapter: the solver.
        folder: of the stage that is at work, or None where nothing is kept.
    """
    if folder is None or not adapter.capabilities().in_process:
        return adapter
    return KeptResponses(adapter, folder)


def _key(simulation: Simulation, adapter: Adapter) -> str:
    digest = hashlib.sha256(
        simulation_key(simulation, f"{adapter.name} {adapter.version()}").encode()
    )
    if simulation.warm_start is not None:
        for array in (simulation.warm_start.times, simulation.warm_start.displacement):
            digest.update(f"{array.shape}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _in_order(response: Response) -> Response:
    """Return a response whose arrays lie in memory as those that are read: sums round alike."""
    arrays: dict[str, Any] = {n: np.ascontiguousarray(getattr(response, n)) for n in _ARRAYS}
    for part in _PARTS:
        value = getattr(response, part)
        if value is not None:
            ordered = {f.name: np.ascontiguousarray(getattr(value, f.name)) for f in fields(value)}
            arrays[part] = replace(value, **ordered)
    return replace(response, **arrays)


def _keep(place: Path, response: Response) -> None:
    """Write a response whole or not at all; a disk that takes no more ends no run."""
    arrays: dict[str, Any] = {name: getattr(response, name) for name in _ARRAYS}
    for part in _PARTS:
        value = getattr(response, part)
        if value is not None:
            arrays |= {f"{part}.{f.name}": getattr(value, f.name) for f in fields(value)}
    beside = {name: getattr(response, name) for name in _COUNTS}
    beside |= {"seconds": dict(response.seconds), "notes": list(response.notes)}
    aside = place.with_name(f"{place.name}.{os.getpid()}")
    try:
        place.parent.mkdir(exist_ok=True)
        with aside.open("wb") as stream:
            np.savez(stream, beside=np.frombuffer(json.dumps(beside).encode(), np.uint8), **arrays)
        os.replace(aside, place)
    except OSError as error:
        with suppress(OSError):
            aside.unlink(missing_ok=True)
        logger.info(f"    {place.parent}: a simulation is not kept ({why(error)})")


def _read(place: Path) -> Response | None:
    """Return a kept response, None where there is none or its checksums do not hold."""
    if not place.is_file():
        return None
    try:
        with place.open("rb") as stream, np.load(stream) as stored:
            found = {name: stored[name] for name in stored.files}
        beside = json.loads(found.pop("beside").tobytes())
        beside["notes"] = tuple(beside["notes"])
        for part, kind in _PARTS.items():
            of_part = {f.name: f"{part}.{f.name}" for f in fields(kind)}
            if set(of_part.values()) <= set(found):
                beside[part] = kind(**{name: found.pop(key) for name, key in of_part.items()})
        return Response(**found, **beside)
    except (OSError, EOFError, BadZipFile, ValueError, KeyError, TypeError):
        logger.info(f"    {place}: a kept simulation is damaged: it is made anew")
        return None

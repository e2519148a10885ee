"""The key of a job: the name of its folder, and of what is known of it already."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from solver_adapters.interface import Simulation
from solver_adapters.simulation_key import simulation_key

_BLOCKS = (b"prismid provenance", b"prismid limits")
_BEGIN, _END = b": begin", b": end"


def job_key(simulation: Simulation, adapter: str, identity: str, files: Mapping[str, bytes]) -> str:
    """SHA-256 of a simulation, adapter, solver and deck.

    Args:
        simulation: what is solved.
        adapter: name of the adapter.
        identity: identity of the solver.
        files: files of the job by name. Of text files provenance and limits are left out; binary
            files (a mesh, whose format may hold the time of day) follow from the simulation.
    """
    return key_with_deck(hash_of_simulation(simulation, adapter, identity), files)


def hash_of_simulation(simulation: Simulation, adapter: str, identity: str) -> str:
    """SHA-256 of a simulation, adapter and solver, without the deck."""
    return simulation_key(simulation, f"{adapter}\n{identity}\n")


def key_with_deck(simulation: str, files: Mapping[str, bytes]) -> str:
    """Return the key of a job.

    Args:
        simulation: as `hash_of_simulation` returns it.
        files: as in `job_key`.
    """
    digest = hashlib.sha256(simulation.encode())
    for name in sorted(files):
        if b"\0" not in files[name]:
            content = what_is_computed(files[name])
            digest.update(f"{name}\n{len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def what_is_computed(deck: bytes) -> bytes:
    """Return a deck without the lines that change no result: its provenance, its limits.

    Provenance (date, version, machine) stands between a line that holds ``prismid provenance:
    begin`` and the next one that holds ``prismid provenance: end``, both included; limits of time,
    memory and cores stand likewise between ``prismid limits: begin`` and ``prismid limits: end``.
    The marks are comments in the language of the deck. A block that does not end is no block.
    """
    lines = deck.splitlines(keepends=True)
    for block in _BLOCKS:
        begin = next((i for i, line in enumerate(lines) if block + _BEGIN in line), len(lines))
        end = next((i for i, line in enumerate(lines) if i > begin and block + _END in line), None)
        if end is not None:
            lines = [*lines[:begin], *lines[end + 1 :]]
    return b"".join(lines)

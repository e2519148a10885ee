"""The key of a job: the name of its folder, and of what is known of it already."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

from solver_adapters.interface import Simulation
from solver_adapters.simulation_key import simulation_key

PROVENANCE_BEGIN = b"prismid provenance: begin"
PROVENANCE_END = b"prismid provenance: end"


def job_key(simulation: Simulation, adapter: str, identity: str, files: Mapping[str, bytes]) -> str:
    """SHA-256 of a simulation, adapter, solver and deck.

    Args:
        simulation: what is solved.
        adapter: name of the adapter.
        identity: identity of the solver.
        files: files of the job by name. Of text files the provenance header is left out; binary
            files (a mesh, whose format may hold the time of day) follow from the simulation.
    """
    digest = hashlib.sha256(simulation_key(simulation, f"{adapter}\n{identity}\n").encode())
    for name in sorted(files):
        if b"\0" not in files[name]:
            content = without_provenance(files[name])
            digest.update(f"{name}\n{len(content)}\n".encode())
            digest.update(content)
    return digest.hexdigest()


def without_provenance(deck: bytes) -> bytes:
    """A deck without its provenance header.

    The header is what stands between a line that holds ``prismid provenance: begin`` and the next
    one that holds ``prismid provenance: end``, both included: comments in the language of the
    deck. A header that does not end is no header.
    """
    lines = deck.splitlines(keepends=True)
    begin = next((i for i, line in enumerate(lines) if PROVENANCE_BEGIN in line), len(lines))
    end = next((i for i, line in enumerate(lines) if i > begin and PROVENANCE_END in line), None)
    return deck if end is None else b"".join([*lines[:begin], *lines[end + 1 :]])

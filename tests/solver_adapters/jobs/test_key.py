"""What the key of a job knows, and what it does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from solver_adapters.jobs.key import job_key, without_provenance
from solver_adapters.material import Material
from tests.solver_adapters.boxes import box, pulled

SIMULATION = pulled(box(), Material(), (0.002,))
HEADER = b"** prismid provenance: begin\n** 3 May\n** prismid provenance: end\n"
FILES = {"job.inp": HEADER + b"*STEP\n", "mesh.med": b"\x89HDF\0 made at noon"}
KEY = job_key(SIMULATION, "bar", "1.0", FILES)


@pytest.mark.parametrize(
    "other",
    [
        (replace(SIMULATION, tolerance=1e-6), "bar", "1.0", FILES),
        (SIMULATION, "rod", "1.0", FILES),
        (SIMULATION, "bar", "1.1", FILES),
        (SIMULATION, "bar1", ".0", FILES),
        (SIMULATION, "bar", "1.0", FILES | {"job.inp": b"*STEP, NLGEOM\n"}),
        (SIMULATION, "bar", "1.0", FILES | {"more.inp": b""}),
    ],
    ids=["simulation", "adapter", "identity", "their border", "deck", "another file"],
)
def test_each_part_of_a_job_changes_its_key(other: tuple[Any, ...]) -> None:
    assert job_key(*other) != KEY


@pytest.mark.parametrize(
    "change",
    [
        {"job.inp": HEADER.replace(b"3 May", b"4 May\n** by night") + b"*STEP\n"},
        {"job.inp": b"*STEP\n"},
        {"mesh.med": b"\x89HDF\0 made at night"},
    ],
    ids=["header", "no header", "time of day in a binary file"],
)
def test_when_and_by_what_a_job_was_written_changes_nothing(change: dict[str, bytes]) -> None:
    assert job_key(SIMULATION, "bar", "1.0", FILES | change) == KEY
    assert job_key(SIMULATION, "bar", "1.0", dict(reversed(FILES.items()))) == KEY


def test_a_header_without_an_end_is_part_of_the_deck() -> None:
    deck = b"# prismid provenance: begin\nSTEP\n"
    assert without_provenance(deck) == deck
    assert without_provenance(b"a\n" + HEADER + b"b\n") == b"a\nb\n"

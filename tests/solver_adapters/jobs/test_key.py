"""What the key of a job knows, and what it does not."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from solver_adapters.jobs.key import job_key, what_is_computed
from solver_adapters.material import Material
from tools.boxes import box, pulled

SIMULATION = pulled(box(), Material(), (0.002,))
LIMITS = b"# prismid limits: begin\nP time_limit 60\n# prismid limits: end\n"
HEADER = b"** prismid provenance: begin\n** 3 May\n** prismid provenance: end\n"
FILES = {"job.inp": HEADER + LIMITS + b"*STEP\n", "mesh.med": b"\x89HDF\0 made at noon"}
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
        {"job.inp": LIMITS.replace(b"60", b"900\nP memory_limit 8000") + HEADER + b"*STEP\n"},
        {"job.inp": b"*STEP\n"},
        {"mesh.med": b"\x89HDF\0 made at night"},
    ],
    ids=["header", "limits", "no header", "time of day in a binary file"],
)
def test_when_by_what_and_within_which_limits_a_job_is_run_changes_nothing(
    change: dict[str, bytes],
) -> None:
    assert job_key(SIMULATION, "bar", "1.0", FILES | change) == KEY
    assert job_key(SIMULATION, "bar", "1.0", dict(reversed(FILES.items()))) == KEY


@pytest.mark.parametrize("block", ["provenance", "limits"])
def test_a_block_without_an_end_is_part_of_the_deck(block: str) -> None:
    deck = f"# prismid {block}: begin\nSTEP\n".encode()
    assert what_is_computed(deck) == deck
    assert what_is_computed(b"a\n" + HEADER + b"b\n" + LIMITS + b"c\n") == b"a\nb\nc\n"

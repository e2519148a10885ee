"""What RESULTS.md tells of the blind trial follows from the lines that stand beside it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from benchmarks.blind_figures import print_figures
from benchmarks.blind_store import read

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"
ROWS = {
    "null: something named": "| null: something named",
    "misfit >= 6 sigma: class": "| misfit ≥ 6 σ: class",
    "misfit >= 6 sigma: name where it is alone in its class": "| – name where it is alone",
    "misfit >= 6 sigma: the set holds the truth": "| – the set holds the truth",
    "misfit >= 6 sigma: spurious addition": "| – mean set; spurious addition",
    "pairs, each >= 4.5 sigma: both": "| pairs, each of 4.5 σ",
    "outside the library, misfit >= 8 sigma: seen": "| outside, ≥ 8 σ: seen",
    "outside the library, misfit >= 8 sigma: unexplained": "| outside, ≥ 8 σ: seen",
}
"""Figures and the rows that tell them, by their beginnings."""


@pytest.fixture(scope="module")
def told() -> list[str]:
    return (BENCHMARKS / "RESULTS.md").read_text(encoding="utf-8").splitlines()


def test_the_table_tells_the_figures_of_the_lines(
    told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    print_figures(read(BENCHMARKS / "blind_trial.jsonl.xz"))
    printed = capsys.readouterr().out
    shares = dict(re.findall(r"^(.+) \[%\] = [\d.]+ (\[.+\] of \d+) \(", printed, re.MULTILINE))
    for figure, beginning in ROWS.items():
        (row,) = (line for line in told if line.startswith(beginning))
        assert shares[figure] in row, figure
    (number,) = re.findall(r"^trials = (\d+)", printed, re.MULTILINE)
    assert any(f"{number} trials of " in line for line in told)


def test_each_line_is_another_trial_of_a_program_that_is_told(told: list[str]) -> None:
    lines = read(BENCHMARKS / "blind_trial.jsonl.xz")
    (command,) = (line for line in told if "--figures --also" in line)
    assert {line["program"] for line in lines} == set(re.findall(r"\b[0-9a-f]{12}\b", command))
    assert len({line["trial"]["name"] for line in lines}) == len(lines)

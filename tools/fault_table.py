"""The table of faults and phases in docs/reliability.md, from what its tests came to.

    python -m tools.fault_table

runs the tests, which take some minutes, and writes the table.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
DOCS, TESTS = ROOT / "docs" / "reliability.md", ROOT / "tests" / "reliability" / "test_faults.py"
BEGIN, END = "<!-- table of faults -->\n", "<!-- end of the table -->\n"

PHASES = ("mesh", "measure", "identify", "diagnose", "report", "export", "virtual", "batch")
"""What is at work as the fault happens: a stage of a run, or a verb."""
FAULTS: Mapping[str, str] = {
    "kill": "`kill -9` of prismid",
    "kill worker": "`kill -9` of a process that works for it",
    "kill solver": "`kill -9` of the program of a solver",
    "SIGTERM": "SIGTERM, as a batch system sends",
    "SIGHUP": "SIGHUP, the terminal is gone",
    "Ctrl-C twice": "Ctrl-C, and again while it ends",
    "read-only": "its folder cannot be written",
    "full disk": "the disk is full",
    "no TMPDIR or HOME": "`TMPDIR`, `/tmp` and `HOME` cannot be written",
    "damage": "a result truncated, another with a byte flipped",
    "two runs": "a second call of the same",
    "clock": "the clock is set back by a year",
    "edited": "the case is edited",
}
"""Faults by the word of their tests, as the table names them."""
_ALONE = frozenset({"mesh", "measure", "report", "export", "virtual"})
LEFT_OUT: Mapping[str, tuple[frozenset[str], str]] = {
    "kill worker": (_ALONE, "no other process works for it"),
    "kill solver": (
        frozenset(PHASES) - {"identify"},
        "no program of a solver runs, or as a job like those of `identify`",
    ),
    "damage": (
        frozenset({"virtual", "export"}),
        "an experiment is read as any other from then on, and an export is always made anew",
    ),
    "edited": (frozenset({"batch"}), "its cases are read by runs, as in the other columns"),
}
"""Phases for which a fault is not tested, with the reason."""


def pairs() -> Iterator[tuple[str, str]]:
    """Yield faults and phases that are tested."""
    for fault in FAULTS:
        for phase in PHASES:
            if phase not in LEFT_OUT.get(fault, (frozenset[str](), ""))[0]:
                yield fault, phase


def table(held: Iterable[tuple[str, str]]) -> str:
    """Return the table and its notes.

    Args:
        held: pairs of a fault and a phase of which all that is said held.
    """
    found, tested = set(held), set(pairs())
    lines = [f"| | {' | '.join(f'`{phase}`' for phase in PHASES)} |", "|---" * 9 + "|"]
    notes: list[str] = []
    for fault, words in FAULTS.items():
        mark = "—"
        if fault in LEFT_OUT:
            notes.append(LEFT_OUT[fault][1])
            mark = f"— ({len(notes)})"
        cells = [
            ("yes" if (fault, phase) in found else "**no**") if (fault, phase) in tested else mark
            for phase in PHASES
        ]
        lines.append(f"| {words} | {' | '.join(cells)} |")
    told = "; ".join(f"({number}) {note}" for number, note in enumerate(notes, 1))
    return "\n".join((*lines, "", f"Not tested: {told}.", ""))


def written(text: str) -> str:
    """Return the table that stands in the text of a document."""
    return text.partition(BEGIN)[2].partition(END)[0]


def _outcomes() -> list[tuple[str, str]]:
    """Run the tests, and return the pairs that held."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-m", "slow", str(TESTS)]
        subprocess.run([*command, f"--junitxml={report}"], cwd=ROOT, check=False)
        cases = list(ElementTree.parse(report).iter("testcase"))
    good = {str(case.get("name")) for case in cases if not len(case)}
    return [pair for pair in pairs() if any(name.endswith(f"[{'-'.join(pair)}]") for name in good)]


def main() -> None:
    """Write the table."""
    text = DOCS.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    _, _, after = rest.partition(END)
    DOCS.write_text(f"{before}{BEGIN}{table(_outcomes())}{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Trials that are done are found again, and truths that other code would make are not."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from benchmarks.blind_store import TRUTHS, cache_folder, kept, of_programs, read

ROOT = Path(__file__).resolve().parents[2]


def test_a_line_that_a_kill_cut_short_is_left_out(tmp_path: Path) -> None:
    results = tmp_path / "results.jsonl"
    assert read(results) == []
    results.write_text('{"trial": 1}\n{"trial": 2}\n{"tri', encoding="utf-8")
    assert read(results) == [{"trial": 1}, {"trial": 2}]


def test_lines_of_another_program_are_counted_and_left_out(
    capsys: pytest.CaptureFixture[str],
) -> None:
    lines = [{"program": name, "trial": {"name": str(k)}} for k, name in enumerate("abac")]
    assert of_programs(lines, ["a"]) == [lines[0], lines[2]]
    assert "1 trial(s) of another program, b," in capsys.readouterr().out
    assert of_programs(lines, ["c", "a"]) == [lines[0], lines[2], lines[3]]


def test_a_trial_of_two_programs_counts_once() -> None:
    lines = [{"program": name, "trial": {"name": "null 1"}} for name in "ab"]
    assert of_programs(lines, ["a", "b"]) == [lines[1]]


def test_what_is_kept_is_made_once(tmp_path: Path) -> None:
    path = tmp_path / "it.pickle"
    assert [kept(path, lambda: 1), kept(path, lambda: 2)] == [1, 1]
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "module",
    ["driver/forward/model.py", "benchmarks/blind_specimen.py", "tools/converged_truth.py"],
)
def test_truths_are_kept_by_all_that_makes_them(module: str, tmp_path: Path) -> None:
    """What stands in no hash may change, and truths of before would be taken for those of now.

    Of cases the hash takes the values.
    """
    tree = ast.parse((ROOT / module).read_text(encoding="utf-8"))
    asked = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module}
    ours = {name for name in asked if name.startswith(("driver.", "benchmarks.", "tools."))}
    parts = {f"{name.replace('.', '/')}.py" for name in ours - {"driver.case.model"}}
    assert len(parts) > 4 and parts | {module} <= set(TRUTHS)
    assert cache_folder(tmp_path).parent == tmp_path

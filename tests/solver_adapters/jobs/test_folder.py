"""The folder of a job: what of a log is told."""

from __future__ import annotations

from pathlib import Path

from solver_adapters.jobs.folder import tail_of


def test_a_log_is_told_in_lines_that_a_person_can_read(tmp_path: Path) -> None:
    (tmp_path / "stdout.txt").write_bytes(
        b"first\n" + b"7" * 3_000_000 + b"\n\x00\x1b[2J\xff\tlast\n"
    )
    (tmp_path / "stderr.txt").write_text("oh\n")
    long, last, error = tail_of(tmp_path).splitlines()
    assert long == 200 * "7" + " …"
    assert last == "\ufffd\ufffd[2J\ufffd  last" and error == "oh"


def test_a_log_ends_with_its_last_lines(tmp_path: Path) -> None:
    (tmp_path / "stdout.txt").write_text("".join(f"step {i}\n" for i in range(100_000)))
    assert tail_of(tmp_path).splitlines() == [f"step {i}" for i in range(99_985, 100_000)]

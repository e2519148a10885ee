"""The folder of a job: its record, and what of a log is told."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from solver_adapters.jobs.folder import Record, read_record, tail_of, write_record
from solver_adapters.result_files import ResultFileError


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


def test_a_job_that_is_removed_as_its_record_is_read_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "key"
    folder.mkdir()
    write_record(folder, Record("bar", "key", "bar 1", status="done"))
    assert read_record(folder, {"done"}) is not None
    read = Path.read_text

    def removed(path: Path, encoding: str) -> str:
        shutil.rmtree(folder)
        return read(path, encoding=encoding)

    monkeypatch.setattr(Path, "read_text", removed)
    assert read_record(folder, {"done"}) is None


def test_a_folder_without_a_record_is_told(tmp_path: Path) -> None:
    with pytest.raises(ResultFileError, match="found no record of a job"):
        read_record(tmp_path, {"done"})

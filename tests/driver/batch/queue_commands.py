"""Commands of campaigns on real queue systems, and what they leave behind."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

SOON_SILENT = (
    "-c",
    "from driver.batch import queue_workers; queue_workers._SILENT = 1.0; "
    "from driver.cli import app; app()",
)
"""A program for which a job is silent before long."""
SOON_TOLD = (SOON_SILENT[0], SOON_SILENT[1].replace("_SILENT", "_PATIENT"))
"""A program that tells before long why jobs wait."""


def command(
    file: Path, variables: Mapping[str, str], program: Sequence[str] = ("-m", "driver.cli")
) -> subprocess.Popen[str]:
    """Begin a campaign by the real command, in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, *program, "batch", str(file)],
        env=variables,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


def left(file: Path, queued: Callable[[], list[str]]) -> list[str]:
    """Jobs in the queue, and workers and calls of a campaign that live: in the end none."""
    found = ["first look"]
    late = time.monotonic() + 60.0
    while found and time.monotonic() < late:
        time.sleep(0.1)
        found = queued()
        for process in psutil.process_iter():
            with suppress(psutil.Error):
                found += [word for word in process.cmdline() if str(file.parent) in word]
    return found


def asked_of(folder: Path, monkeypatch: pytest.MonkeyPatch, name: str, asked: str) -> Path:
    """Put a command there that answers with a file, to these arguments alone."""
    script, answer = folder / name, folder / f"{name}.says"
    script.write_text(f'#!/bin/sh\n[ "$*" = "{asked}" ] && cat "{answer}"\n', encoding="utf-8")
    script.chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:/usr/bin:/bin")
    return answer

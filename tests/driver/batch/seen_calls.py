"""Calls of prismid that workers make for the cases of a campaign, seen as they come."""

from __future__ import annotations

import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import psutil


class SeenCalls:
    """Looks for such calls of this machine as long as its context lasts.

    Args:
        file: of the campaign.
        act: is called with each of them, and how many were before.

    Attributes:
        of_case: calls by the folder of their case, with the name of their job of Slurm or PBS.
        all: the processes.
    """

    def __init__(self, file: Path, act: Callable[[psutil.Process, int], None]) -> None:
        self.of_case: dict[str, list[str]] = {}
        self.all: list[psutil.Process] = []
        self._above, self._act, self._over = f"{file.parent}/", act, threading.Event()
        self._thread = threading.Thread(target=self._look)

    def __enter__(self) -> SeenCalls:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._over.wait(0.1):
            for process in psutil.process_iter():
                with suppress(psutil.Error):
                    self._see(process)

    def _see(self, process: psutil.Process) -> None:
        call = process.cmdline()
        if process in self.all or "--end-with-input" not in call:
            return
        place = next((Path(word) for word in call if word.startswith(self._above)), None)
        if place is not None:
            named = process.environ()
            job = named.get("SLURM_JOB_ID", named.get("PBS_JOBID", "none"))
            self.all.append(process)
            self.of_case.setdefault(place.parent.name, []).append(job)
            self._act(process, len(self.all) - 1)

"""A process that has loaded prismid, and forks into one for each call of it that a test asks for.

A call has a gate: a point of the program at which it waits as long as there is a file `closed`,
found by an event of Python's audit, so that nothing is guessed from the time. The disk that a call
sees may be full or read-only, by mounts that no other process sees.
"""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil

from solver_adapters.kernels import PACKAGES
from solver_adapters.user_folders import cache_folder
from tests.reliability.gate import FOLDER, GATE, install

_CLONE_NEWNS = 0x00020000
_WHOLE_DISK = 64_000_000  # bytes of a disk that is filled
_ROOM = 6_000  # bytes that are left of it
_WAITING = 0.1  # s between two looks at all processes, each of which takes some milliseconds
_SITE = "from tests.reliability import gate\ngate.install()\n"
_POINTS = """[prismid.solvers]
closed_form = tests.reliability.solvers:Closed
closed_form_program = tests.reliability.solvers:ClosedProgram
"""


@dataclass
class Call:
    """A call of prismid that a test has asked for.

    Attributes:
        process: what carries it out.
        log: what it says.
        seen: processes of it that were alive at some time, beside the first one.
    """

    process: psutil.Process
    log: Path
    laboratory: Laboratory
    seen: set[psutil.Process] = field(default_factory=set)

    def look(self) -> set[psutil.Process]:
        """Note the processes that it has started."""
        try:
            self.seen |= set(self.process.children(recursive=True))
        except psutil.Error:
            pass
        return self.seen

    def reached(self, many: int = 1) -> list[int]:
        """Wait until so many processes of it are at the gate, and return them."""
        while len(there := self.laboratory.marks("reached")) < many:
            assert self.laboratory.code(self, 0.0) is None, f"it has ended: {self.text()}"
            time.sleep(_WAITING)
        self.look()
        return there

    def end(self, seconds: float = 300.0) -> int:
        """Wait for its end, and return the exit code."""
        code = self.laboratory.code(self, seconds)
        assert code is not None, f"it goes on: {self.text()}"
        return code

    def text(self) -> str:
        return self.log.read_text("utf-8", errors="replace") if self.log.exists() else ""

    def living(self, seconds: float) -> list[psutil.Process]:
        """Processes of it that still live after some seconds."""
        others = [p for p in psutil.process_iter() if self._is_of_it(p)]
        known = {self.process, *self.seen, *others}
        _, alive = psutil.wait_procs(list(known), timeout=seconds)
        return [p for p in alive if p.status() != psutil.STATUS_ZOMBIE]

    def _is_of_it(self, process: psutil.Process) -> bool:
        try:
            return process.environ().get(FOLDER + "_CALL") == str(self.log)
        except psutil.Error:
            return False


class Laboratory:
    """The process, and what a test asks it for.

    Args:
        folder: for the gate and the logs.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        site, points = folder / "site", folder / "site" / "laboratory-1.0.dist-info"
        points.mkdir(parents=True)
        (site / "sitecustomize.py").write_text(_SITE)
        (points / "METADATA").write_text("Metadata-Version: 2.1\nName: laboratory\nVersion: 1.0\n")
        (points / "entry_points.txt").write_text(_POINTS)
        path = os.pathsep.join((str(site), str(PACKAGES)))
        (folder / "home").mkdir()
        own = {
            FOLDER: str(folder), "PYTHONPATH": path, "XDG_CONFIG_HOME": str(folder / "home"),
            # Calls without a home find the kernels that are compiled.
            "NUMBA_CACHE_DIR": str(cache_folder(os.environ.get("NUMBA_CACHE_DIR"))),
        }  # fmt: skip
        self._process = subprocess.Popen(
            [sys.executable, "-m", "tests.reliability.laboratory"], env=os.environ | own,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._count = 0
        assert self._answer() == "ready"

    def close(self) -> None:
        """Let no call wait at the gate any more, and end."""
        self.open()
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()

    def start(
        self,
        *call: str,
        gate: str = "",
        read_only: Sequence[Path] = (),
        writable: Sequence[Path] = (),
        full: Path | None = None,
        variables: Mapping[str, str] | None = None,
    ) -> Call:
        """Start a call of prismid.

        Args:
            call: its words.
            gate: event and pattern of where it waits, nothing for nowhere.
            read_only: folders that cannot be written.
            writable: folders in them that can.
            full: a folder on a disk that is full.
            variables: of its environment.
        """
        self._count += 1
        log = self.folder / f"{self._count}.log"
        for mark in ("reached", "interrupted"):
            for file in self.folder.glob(f"{mark}.*"):
                file.unlink()
        if gate:
            (self.folder / "closed").touch()
        own = {GATE: gate, FOLDER + "_CALL": str(log), **(variables or {})}
        asked = {
            "call": call, "log": str(log), "variables": own, "full": str(full or ""),
            "read_only": [str(path) for path in read_only],
            "writable": [str(path) for path in writable],
        }  # fmt: skip
        return Call(psutil.Process(int(self._asked(asked))), log, self)

    def run(self, *call: str, **options: Any) -> tuple[int, str]:
        """Carry out a call that waits nowhere, and return its exit code and what it says."""
        made = self.start(*call, **options)
        return made.end(), made.text()

    def open(self) -> None:
        (self.folder / "closed").unlink(missing_ok=True)

    def marks(self, name: str) -> list[int]:
        """Processes that have left a mark."""
        return [int(path.suffix[1:]) for path in self.folder.glob(f"{name}.*")]

    def code(self, call: Call, seconds: float) -> int | None:
        """Exit code of a call that ends within some seconds, None of one that goes on."""
        end = time.monotonic() + seconds
        while (told := self._asked({"wait": call.process.pid})) == "":
            call.look()
            if time.monotonic() >= end:
                return None
            time.sleep(_WAITING)
        return int(told)

    def _asked(self, what: Mapping[str, Any]) -> str:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(what) + "\n")
        self._process.stdin.flush()
        return self._answer()

    def _answer(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


def main() -> None:
    """Carry out calls until nobody is left to ask."""
    # What verbs import when they are called.
    import driver.batch.command
    import driver.export.command
    import driver.report.page
    import driver.virtual.command
    import driver.workflow.pipeline  # noqa: F401
    from prismid.__main__ import main as program

    ended: dict[int, int] = {}
    print("ready", flush=True)
    while line := sys.stdin.readline():
        asked = json.loads(line)
        if "wait" in asked:
            print(_ended(asked["wait"], ended), flush=True)
            continue
        child = os.fork()
        if child == 0:
            _carry_out(asked)
            program()
            sys.exit()
        print(child, flush=True)


def _ended(child: int, ended: dict[int, int]) -> str:
    if child not in ended:
        found, status = os.waitpid(child, os.WNOHANG)
        if not found:
            return ""
        ended[child] = os.waitstatus_to_exitcode(status)
    return str(ended[child])


def _carry_out(asked: Mapping[str, Any]) -> None:
    """Make this process what carries out a call: a process of its own with its own terminal."""
    os.setsid()
    log = os.open(asked["log"], os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    nothing = os.open(os.devnull, os.O_RDONLY)
    for stream, end in ((0, nothing), (1, log), (2, log)):
        os.dup2(end, stream)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)
    os.environ.update(asked["variables"])
    if asked["full"] or asked["read_only"]:
        _on_another_disk(asked)
    install()
    sys.argv = ["prismid", *asked["call"]]


def _on_another_disk(asked: Mapping[str, Any]) -> None:
    """Go on as a child of this process on the disk that is asked for, which ends as it does."""
    # Mounts of this process and its children alone.
    if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNS):
        raise OSError(ctypes.get_errno(), "no mounts of its own")
    _mount("--make-rprivate", "/")
    full, disk = asked["full"], Path(asked["log"]).with_suffix(".disk")
    if full:
        disk.mkdir()
        _mount("-t", "tmpfs", "-o", f"size={_WHOLE_DISK}", "none", str(disk))
        shutil.copytree(full, disk / "folder", symlinks=True)
        _fill(disk / "filling")
        _mount("--bind", str(disk / "folder"), full)
    for path in asked["writable"]:
        _mount("--bind", path, path)
    for path in asked["read_only"]:
        _mount("--rbind", path, path)
        _mount("-o", "remount,bind,ro", path)
    child = os.fork()
    if child == 0:
        return
    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if full:  # what is left there is found by the next call
        subprocess.run(("umount", full), check=True)
        for entry in Path(full).iterdir():
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        shutil.copytree(disk / "folder", full, dirs_exist_ok=True, symlinks=True)
    os._exit(code)


def _mount(*words: str) -> None:
    subprocess.run(("mount", *words), check=True)


def _fill(path: Path) -> None:
    """Fill a disk but for a little room."""
    with path.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(1 << 16))
        except OSError:
            file.truncate(max(0, file.tell() - _ROOM))


if __name__ == "__main__":
    main()

"""How a verb ends: what a user can mend in a sentence, and a fault of the program in another."""

from __future__ import annotations

import errno
import json
import os
import shutil
import tempfile
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import typer

from driver.case.model import load_case
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence, why
from driver.results.files import FAULT, RESULTS, results_of, with_results
from driver.terminal.exit_codes import DONE, FAILED
from driver.terminal.exit_codes import FAULT as FAULT_CODE
from driver.terminal.output import tell, tell_error
from driver.terminal.stopping import refuse_to_go_on
from meshes.system_libraries import SystemLibraryError
from solver_adapters.interface import PreparedError, SolverError
from solver_adapters.user_folders import cache_folder

_FULL = 4e6
"""Bytes below which a folder counts as full: a compiled kernel has up to two million."""

Status = Literal["done", "prepared", "failed", "fault"]
CODES: dict[Status, int] = {
    "done": DONE, "prepared": DONE, "failed": FAILED, "fault": FAULT_CODE
}  # fmt: skip


@dataclass(frozen=True)
class Ending:
    """How the run of a case has ended.

    Attributes:
        status: "done", "prepared" (jobs for another machine), "failed", or "fault" of prismid.
        messages: why, a sentence each.
    """

    status: Status
    messages: tuple[str, ...] = ()


def ending_of(work: Callable[[], None], results: Path) -> Ending:
    """Do the work of one case, and return how it has ended.

    Args:
        work: what is done.
        results: the folder in which the traceback of a fault of prismid is kept, if it is there.

    Raises:
        KeyboardInterrupt: it was stopped.
    """
    try:
        work()
    except PreparedError as prepared:
        return Ending("prepared", tuple(str(prepared).splitlines()))
    except Exception as error:
        # A library may have made another error of a stop.
        refuse_to_go_on()
        said = _said(error)
        if said is None:
            return Ending("fault", (_fault(error, results),))
        return Ending("failed", tuple(said.splitlines()))
    return Ending("done")


@contextmanager
def told_in_one_line() -> Iterator[None]:
    """Turn what a user can mend into a line on standard error and the exit code of a failure.

    Raises:
        typer.Exit: there was such an error.
    """
    try:
        yield
    except Exception as error:
        refuse_to_go_on()
        said = None if isinstance(error, PreparedError) else _said(error)
        if said is None:
            raise
        tell_error(said)
        raise typer.Exit(FAILED) from None


def tell_ending(case: str, ending: Ending, prefix: str) -> None:
    """Tell how the run of a case has ended, if there is more to say than that it is done.

    Args:
        case: as the user has named it.
        ending: how.
        prefix: what a line of an error begins with.
    """
    if ending.status == "prepared":
        tell("\n".join((f"{case}: {ending.messages[0]}", *ending.messages[1:])))
    else:
        tell_error("\n".join(ending.messages), prefix)


def results_at(case: Path, stated: Path | None) -> Path:
    """Return the folder of the results of a case file; the usual one if it cannot be used."""
    try:
        return results_of(with_results(load_case(case), stated))
    except Exception:  # whatever is wrong with it is told where it is run
        return case.parent / RESULTS


def _said(error: Exception) -> str | None:
    """Return what an error says of what a user can mend, None for any other."""
    from driver.experiment.images.heightmaps import ImageError

    if isinstance(error, OSError):
        return _of_the_system(error)
    if isinstance(error, MemoryError):
        return f"memory: found {why(error)}, expected more of it, or a smaller case"
    if isinstance(error, InputError | ImageError | SolverError | SystemLibraryError):
        return str(error)
    return None


def _of_the_system(error: OSError) -> str:
    """Return what the system refused: the file, and what it said."""
    if error.filename is not None:
        found = f"{why(error)} of the system"
        expected = "one that can be read and written here"
        return sentence(error.filename, "file", found, expected)
    if str(error.strerror).startswith("No usable temporary directory"):
        found, expected = why(error), "a folder that can be written and has space"
        return sentence(Path("TMPDIR"), "folder of temporary files", found, expected)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        full = ", ".join(str(folder) for folder in _full_folders())
        found = f"{why(error)} of the system" + (f" and none left in {full}" if full else "")
        return f"disk: found {found}, expected free space: run again to go on"
    return " ".join(str(error).split())


def _full_folders() -> Iterator[Path]:
    """Yield those folders of the cache, of temporary files and of the call that are full."""
    places: tuple[Callable[[], Path | None], ...] = (
        lambda: cache_folder(os.environ.get("NUMBA_CACHE_DIR")),
        lambda: Path(tempfile.gettempdir()),
        Path.cwd,
    )
    for place in places:
        with suppress(OSError):  # one that is not there, or cannot be asked
            folder = place()
            if folder is not None and shutil.disk_usage(folder).free < _FULL:
                yield folder


def _fault(error: Exception, results: Path) -> str:
    """Keep the traceback of a fault of prismid, and return a sentence that says where."""
    text = "".join(traceback.format_exception(error))
    path = results / FAULT
    try:
        if results.is_symlink() or not results.is_dir():
            path = Path(tempfile.mkdtemp(prefix="prismid-fault-"), FAULT)
        write_whole(path, text.encode("utf-8", "backslashreplace"))
        kept = f"the traceback in {path}"
    except OSError:
        kept = f"this: {json.dumps(text)}"
    told = f"{type(error).__name__}: {' '.join(str(error).split())}".removesuffix(": ")
    return f"a fault of prismid has ended it ({told}); please report it with {kept}"

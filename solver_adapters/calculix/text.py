"""Text files that CalculiX has left, and what is wrong with them."""

from __future__ import annotations

from pathlib import Path

from solver_adapters.result_files import ResultFileError


def read_text(path: Path, what: str) -> str:
    """Return the text of a result file.

    Args:
        path: the file.
        what: what it should hold, for the message.

    Raises:
        ResultFileError: there is no such file, it cannot be read, or it is empty.
    """
    try:
        text = path.read_text(encoding="ascii", errors="replace")
    except FileNotFoundError:
        raise ResultFileError(f"{path.name}: found no such file, expected {what}") from None
    except OSError as error:
        raise ResultFileError(
            f"{path.name}: found no file that can be read ({error.strerror}), expected {what}"
        ) from None
    if not text.strip():
        raise ResultFileError(f"{path.name}: found an empty file, expected {what}")
    return text

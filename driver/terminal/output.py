"""Texts on standard output and standard error, whatever stands in them and whoever shows them."""

from __future__ import annotations

import io
import sys
from typing import TYPE_CHECKING

from rich.console import Console

from driver.common.formatting import printable

if TYPE_CHECKING:
    from rich.table import Table

_WIDEST = 1000  # columns


def tolerate_any_encoding() -> None:
    """Replace what the terminal has no sign for, where Python would raise an error."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def tell(text: str, err: bool = False) -> None:
    """Show a text; control characters of files never reach the terminal.

    Args:
        text: one line or several.
        err: whether on standard error.
    """
    print(printable(text), file=sys.stderr if err else sys.stdout, flush=True)


def tell_error(text: str, prefix: str = "") -> None:
    """Show a text of sentences, a line each, as what went wrong.

    Args:
        text: the sentences.
        prefix: what a line begins with after the name of the program, unless it does so itself.
    """
    for line in text.splitlines():
        # A line that begins with the file of the case says which it is.
        known = prefix and line.startswith(prefix.removesuffix(": "))
        tell(f"prismid: {'' if known else prefix}{line}", err=True)


def show_table(table: Table) -> None:
    """Show a table, as wide as it is where nobody looks at it on a terminal."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDEST)
    console.print(table)

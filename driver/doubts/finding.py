"""What was looked at before a run, and found."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        level: "ok", "warning" (a run works, but look at it) or "error" (a run would stop).
        subject: what was looked at.
        message: what was found; of an error also what was expected.
    """

    level: Literal["ok", "warning", "error"]
    subject: str
    message: str

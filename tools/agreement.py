"""How far two solvers agree, as figures with goals and as the table of docs/agreement.md."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from meshes.arrays import FloatArray


@dataclass(frozen=True)
class Agreement:
    """One figure of a comparison.

    Attributes:
        pair: the solvers, and what they solved.
        quantity: what is compared, with its unit in brackets.
        found: the figure.
        goal: what it should not exceed, or None for a figure that is only stated.
        cause: what the difference comes from, said where the goal is missed.
    """

    pair: str
    quantity: str
    found: float
    goal: float | None = None
    cause: str = ""

    def line(self) -> str:
        """Return the figure on a line, as the command prints it."""
        goal = "" if self.goal is None else f" (goal: <= {self.goal:g}{self._missed()})"
        return f"{self.pair}: {self.quantity} = {self.found:.2g}{goal}"

    def row(self) -> str:
        """Return the figure as a row of the table."""
        goal = "" if self.goal is None else f"≤ {self.goal:g}{self._missed()}"
        return f"| {self.pair} | {self.quantity} | {self.found:.2g} | {goal} |"

    def _missed(self) -> str:
        if self.goal is None or self.found <= self.goal:
            return ""
        return f"; missed: {self.cause}" if self.cause else "; missed"


def force_error(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference of two forces [% of the largest expected one], both of shape (n,)."""
    return float(100 * abs(found - expected).max() / abs(expected).max())


def motion_error(found: FloatArray, expected: FloatArray) -> float:
    """Largest difference of a component of two displacements in µm [nm], of equal shapes."""
    return float(1000 * np.abs(found - expected).max())


def table(rows: Sequence[Agreement]) -> str:
    """Return the figures as a Markdown table."""
    lines = ["| pair | quantity | found | goal |", "|---|---|---|---|"]
    return "\n".join([*lines, *(row.row() for row in rows)]) + "\n"

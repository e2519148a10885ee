"""The result files of a real run of CalculiX, and what was asked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.templates.golden_decks import CASES

DATA = Path(__file__).parents[2] / "data" / "solver" / "calculix"
ASKED = CASES["octahedral"]
HELD = np.array([2.0, 4.0, 6.0])
"""Ends of its steps [s]."""

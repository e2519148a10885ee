"""The case of `prismid init` with stated cells, for tests that mesh it without choosing sizes."""

from __future__ import annotations

from driver.case.model import Case, default_case


def stated_case() -> Case:
    """Hexahedra of 2 and 1 µm."""
    return default_case().with_values_at(
        {
            "specimen.cells": "hex20",
            "specimen.mesh_size_um": 2.0,
            "specimen.fine_mesh_size_um": 1.0,
        }
    )

"""A case of three grains in a bar of copper."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from driver.case.model import Case, default_case

BOUNDARIES = (
    {"point_um": (0.0, 4.0, 0.0), "normal": (0.1, 1.0, 0.2)},
    {"point_um": (0.0, 8.2, 0.0), "normal": (-0.15, 1.0, 0.1)},
)
ANGLES = ((281.0, 8.0, 47.0), (211.0, 45.0, 150.0), (30.0, 20.0, 10.0))


def tables() -> dict[str, Any]:
    """Return the tables of the case."""
    data = default_case("fcc", "bar").model_dump(mode="json")
    data["specimen"] |= {
        "boundary_point_um": None,
        "boundary_normal": None,
        "boundaries": BOUNDARIES,
        "cells": "hex20",
        "mesh_size_um": 2.0,
        "fine_mesh_size_um": 1.0,
    }
    names = ("left", "middle", "right")
    data["grains"] = [
        {"name": name, "euler_deg": angles} for name, angles in zip(names, ANGLES, strict=True)
    ]
    return data


def three_grains(file: Path = Path("case.toml"), **changes: dict[str, Any]) -> Case:
    """Return the case, with other keys in some of its tables."""
    data = tables()
    for table, keys in changes.items():
        data[table] |= keys
    return Case.model_validate(data, context={"file": file})

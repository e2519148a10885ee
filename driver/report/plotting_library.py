"""The plotting library of the page: two bundles of plotly.js, which the page holds itself."""

from __future__ import annotations

import base64
from pathlib import Path

import templates

FOLDER = Path(templates.__file__).parent / "plotly"
"""The bundles, their licence and where they come from."""
FLAT, SOLID = "cartesian", "gl3d"
"""The bundles: curves and maps; surfaces in space."""


def bundle(name: str) -> str:
    """Return a bundle compressed by gzip, as base64."""
    content = (FOLDER / f"plotly-{name}.min.js.gz").read_bytes()
    return base64.b64encode(content).decode("ascii")


def licence() -> str:
    """Return the licence, which goes with every copy."""
    return (FOLDER / "LICENSE").read_text("utf-8")

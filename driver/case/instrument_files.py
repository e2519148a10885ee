"""Files of profilometers and atomic force microscopes, whose heights are lengths by themselves."""

from __future__ import annotations

from pathlib import PurePath

INSTRUMENTS = {
    ".al3d": "al3d", ".bcrf": "bcr", ".datx": "datx", ".di": "di", ".ezd": "ezd", ".frt": "frt",
    ".gwy": "gwy", ".ibw": "ibw", ".jpk": "jpk", ".lext": "lext", ".mi": "mi", ".mnt": "mnt",
    ".nid": "ezd", ".opd": "opd", ".opdx": "opdx", ".os3d": "os3d", ".plu": "plu", ".plux": "plux",
    ".poir": "poir", ".sdf": "sdf", ".spm": "di", ".stp": "wsxm", ".sur": "sur", ".top": "wsxm",
    ".vk3": "vk", ".vk4": "vk", ".vk6": "vk", ".vk7": "vk", ".x3p": "x3p", ".zmg": "zmg",
    ".zon": "zon",
}  # fmt: skip
"""Endings of their names, and what SurfaceTopography calls their formats."""
LEVEL_NM = 1.0
"""Height of one level of such a file: its heights are handed out in nanometres."""


def is_of_instrument(name: object) -> bool:
    """Whether the name of a file or a pattern ends as those of instruments do."""
    return isinstance(name, str) and PurePath(name).suffix.lower() in INSTRUMENTS

"""What a file of results holds and what the documentation says of it, each read by itself."""

from __future__ import annotations

import re
from pathlib import Path

import h5py

DOCS = Path(__file__).resolve().parents[3] / "docs"


def datasets(path: Path) -> dict[str, tuple[tuple[int, ...], str]]:
    """Shape and unit of each dataset of an HDF5 file, by name."""
    found: dict[str, tuple[tuple[int, ...], str]] = {}

    def take(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = (item.shape, item.attrs["unit"])

    with h5py.File(path, "r") as file:
        file.visititems(take)
    return found


def section(heading: str) -> str:
    """A section of docs/results.md."""
    text = (DOCS / "results.md").read_text(encoding="utf-8")
    return text.split(f"\n## `{heading}`\n")[1].split("\n## ")[0]


def documented_datasets(heading: str) -> set[str]:
    """Names in the first column of the table of datasets of a section."""
    table = section(heading).split("| dataset | shape | unit | what |\n")[1].split("\n\n")[0]
    return {
        name
        for line in table.splitlines()[1:]
        for name in re.findall(r"`([^`]+)`", line.split(" | ")[0])
    }

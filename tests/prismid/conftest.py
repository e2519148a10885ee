"""The example alpha with a third of its images, and what correlation finds in them."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import pytest
import tifffile

import prismid

ALPHA = Path(__file__).resolve().parents[2] / "examples" / "alpha"
EVERY, FLATS = 3, 60


@pytest.fixture(scope="session")
def measured_alpha(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A folder `alpha` after the stage measure, and the lines that the run has told."""
    folder = tmp_path_factory.mktemp("python") / "alpha"
    folder.mkdir()
    for name in ("case.toml", "case.schema.json", "repeats.tif"):
        shutil.copy(ALPHA / name, folder / name)
    frames = tifffile.imread(ALPHA / "images.tif")
    tifffile.imwrite(folder / "images.tif", frames[::EVERY], photometric="minisblack")
    flats = tifffile.imread(ALPHA / "flats.tif")[:FLATS]
    tifffile.imwrite(folder / "flats.tif", flats, photometric="minisblack")
    with (ALPHA / "history.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (folder / "history.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        for row in rows:
            image = row["image"]
            kept = image != "" and int(image) % EVERY == 0
            row["image"] = str(int(image) // EVERY) if kept else ""
            writer.writerow(row)
    told: list[str] = []
    with prismid.progress_to(told.append):
        prismid.run(folder, until="measure")
    return folder, told


@pytest.fixture
def alpha(
    measured_alpha: tuple[Path, list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A copy of it in the current folder."""
    copied = tmp_path / "alpha"
    shutil.copytree(measured_alpha[0], copied)
    monkeypatch.chdir(tmp_path)
    return copied

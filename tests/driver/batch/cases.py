"""Cases of campaigns that mesh in no time."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import tifffile

from driver.batch.jobs import Job
from driver.case.model import write_case
from driver.workflow.cost import Cost
from solver_adapters.kernels import PACKAGES
from tools.short_specimen import small_case

HISTORY = "time_s,stage_um,image,force_N\n0,0,0,0\n10,5,1,1\n20,10,2,2\n"


def job(folder: Path, name: str = "a", *calls: tuple[str, ...], seconds: float = 1.0) -> Job:
    """The job of a case in a folder."""
    log, lock = (folder / "logs" / f"{name}.{kind}" for kind in ("log", "lock"))
    cost = Cost(seconds, 1e9, 1)
    return Job(name, "cases.1", folder / "case.toml", calls, "report", log, lock, cost)


def write_small_case(folder: Path) -> Path:
    """A short specimen of a few hexahedra, with two images of nothing."""
    folder.mkdir(parents=True)
    cells = {"specimen.cells": "hex20", "specimen.mesh_size_um": 2.0}
    case = small_case().with_values_at(cells)
    (folder / case.history.file).write_text(HISTORY)
    nothing = np.zeros((3, 72, 152), dtype=np.uint8)
    tifffile.imwrite(folder / "images.tif", nothing, photometric="minisblack")
    write_case(case, folder / "case.toml")
    return folder / "case.toml"


def agreed(file: Path) -> dict[str, str]:
    """Variables of a user who has agreed to what a campaign asks for, by the real command."""
    own = {"XDG_CONFIG_HOME": str(file.parent / "config"), "PYTHONPATH": str(PACKAGES)}
    command = [sys.executable, "-m", "driver.cli", "trust", "--yes", str(file)]
    subprocess.run(command, env=os.environ | own, check=True, stdout=subprocess.DEVNULL)
    return own


def rows(file: Path) -> dict[str, dict[str, str]]:
    """Rows of the summary of a campaign, by case."""
    with (file.with_suffix(".batch") / "summary.csv").open(encoding="utf-8") as table:
        return {row["case"]: row for row in csv.DictReader(table)}

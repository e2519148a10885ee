"""What the blind trials keep on disk, and which program made it."""

from __future__ import annotations

import json
import lzma
import os
import pickle
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

from benchmarks.blind_specimen import known_case
from driver.results.hdf5 import prismid_version
from solver_adapters.bundled.identity import solver_hash
from solver_adapters.kernels import PACKAGES, hash_of
from tools.converged_truth import true_case

Kept = TypeVar("Kept")
Record = dict[str, Any]

# Of what makes truths and tells their size, beside the solver and the two cases.
TRUTHS = (
    "tools/short_specimen.py",
    "tools/stage_histories.py",
    "tools/beyond_parameters.py",
    "tools/converged_truth.py",
    "tools/mesh_reference.py",
    *(f"benchmarks/blind_{name}.py" for name in ("plan", "ruler", "specimen")),
    *(
        f"driver/{name}.py"
        for name in (
            "diagnosis/causes/ebsd_flips", "dic/surface_images", "experiment/history",
            "forward/boundary_motion", "forward/build", "forward/dwell_time",
            "case/specimen", "forward/fixed_pattern", "forward/instrument", "forward/load_lag",
            "forward/mesh_extrapolation", "forward/microstructure", "forward/model",
            "forward/prediction",
            "forward/surface_projection", "identification/correction", "identification/data",
            "identification/image_data", "identification/objective",
            "identification/reference_noise",
            "parameters/boundary", "parameters/history", "parameters/instrument",
            "parameters/microstructure", "parameters/pose", "parameters/registry",
            "parameters/user_terms", "virtual/microscope/face_motion", "virtual/truth",
        )
    ),
)  # fmt: skip


def cache_folder(root: Path) -> Path:
    """Where what all trials share is kept; another specimen or other code has another.

    Args:
        root: the folder of all such folders.
    """
    cases = [case.model_dump_json() for case in (known_case(), true_case())]
    sources = (*(PACKAGES / name for name in TRUTHS), *sorted((PACKAGES / "meshes").glob("*.py")))
    versions = {"cases": json.dumps(cases), "solver": solver_hash()}
    folder = root / hash_of(sources, versions)[:12]
    folder.mkdir(parents=True, exist_ok=True)
    return folder


@cache
def program() -> str:
    """Hash of all that a trial runs after its truth: results of two are not mixed unasked."""
    trials = (PACKAGES / f"benchmarks/blind_{name}.py" for name in ("cases", "misfit", "trial"))
    parts = (PACKAGES / name for name in ("driver", "meshes", "solver_adapters"))
    sources = sorted([*trials, *(path for part in parts for path in part.rglob("*.py"))])
    return hash_of(sources, {"prismid": prismid_version(), "solver": solver_hash()})[:12]


def kept(path: Path, make: Callable[[], Kept]) -> Kept:
    """Return what a file of the cache holds, made and written if it is not there."""
    if path.is_file():
        with path.open("rb") as file:
            stored: Kept = pickle.load(file)
        return stored
    made = make()
    unfinished = path.with_suffix(f".{os.getpid()}")
    unfinished.write_bytes(pickle.dumps(made))
    unfinished.replace(path)  # two processes may have made the same one
    return made


def read(results: Path) -> list[Record]:
    """Return lines of a results file, compressed or not; one that a kill cut short is left out."""
    if not results.is_file():
        return []
    content = results.read_bytes()
    if results.suffix == ".xz":
        content = lzma.decompress(content)
    lines = []
    for text in content.decode("utf-8").splitlines():
        try:
            lines.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return lines


def of_programs(lines: list[Record], wanted: Collection[str]) -> list[Record]:
    """Return the lines of some programs, the last of each trial; others are counted and told."""
    others: dict[str, int] = {}
    for line in lines:
        if line["program"] not in wanted:
            others[line["program"]] = others.get(line["program"], 0) + 1
    for other, number in others.items():
        print(f"{number} trial(s) of another program, {other}, are left out")
    kept = {line["trial"]["name"]: line for line in lines if line["program"] in wanted}
    return list(kept.values())

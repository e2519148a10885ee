"""A case run until its parameters are identified: CPU time by stage, and what was found."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py

from driver.case.model import load_case, write_case
from driver.common.progress import progress_to
from driver.results.files import RESULTS
from driver.results.hdf5 import read_hdf5
from driver.workflow import pipeline
from meshes.arrays import FloatArray

_SECONDS = "cpu_seconds.json"


@dataclass
class StageClock:
    """What splits the CPU time of a run at the lines that begin a stage.

    Attributes:
        seconds: CPU time by stage, in the order of the run.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    _stage: str = "mesh"
    _since: float = field(default_factory=time.process_time)

    _BEGINNINGS = (
        ("measure: started", "measure"),
        ("stage A:", "A"),
        ("stage B:", "B"),
        ("finer mesh", "correction"),
        ("stage C:", "C"),
    )

    def __call__(self, line: str) -> None:
        """Print a line, and count the time before it to the stage that it ends."""
        print(f"  {line}", flush=True)
        now = time.process_time()
        self.seconds[self._stage] = self.seconds.get(self._stage, 0.0) + now - self._since
        self._since = now
        for beginning, stage in self._BEGINNINGS:
            if line.startswith(beginning):
                self._stage = stage


@dataclass(frozen=True, eq=False)
class Found:
    """What an identification found.

    Attributes:
        names: free parameters.
        value, sigma: their values and standard deviations, shape (k,).
        correlation: shape (k, k).
        values: every parameter of the general model.
        arrays: all datasets of `identify.h5`.
        history: fits A, B, C of `identify_history.json`.
        seconds: CPU time by stage of the run that found it.
    """

    names: tuple[str, ...]
    value: FloatArray
    sigma: FloatArray
    correlation: FloatArray
    values: Mapping[str, float]
    arrays: Mapping[str, FloatArray]
    history: Mapping[str, dict[str, Any]]
    seconds: Mapping[str, float]

    def deviations(self, truth: Mapping[str, float]) -> dict[str, float]:
        """(value − truth)/σ of the parameters whose truth is given."""
        off = zip(self.names, self.value, self.sigma, strict=True)
        return {name: (v - truth[name]) / s for name, v, s in off if name in truth}

    def of(self, name: str) -> tuple[float, float]:
        """Value and standard deviation of a parameter."""
        index = self.names.index(name)
        return float(self.value[index]), float(self.sigma[index])


def identify_case(case_path: Path) -> Found:
    """Run a case until `identify`, or take what is there and unchanged."""
    clock = StageClock()
    with progress_to(clock):
        pipeline.run(case_path, "identify", False)
    if "C" in clock.seconds:
        (case_path.parent / RESULTS / _SECONDS).write_text(json.dumps(clock.seconds), "utf-8")
    return read_found(case_path)


def read_found(case_path: Path) -> Found:
    """Return what the results beside a case say."""
    results = case_path.parent / RESULTS
    arrays = read_hdf5(results / "identify.h5")
    with h5py.File(results / "identify.h5") as file:
        texts = {name: file.attrs[name] for name in ("names", "all_values")}
    return Found(
        names=tuple(json.loads(texts["names"])),
        value=arrays["values"],
        sigma=arrays["sigma"],
        correlation=arrays["correlation"],
        values=json.loads(texts["all_values"]),
        arrays=arrays,
        history=json.loads((results / "identify_history.json").read_text("utf-8")),
        seconds=json.loads((results / _SECONDS).read_text("utf-8")),
    )


def read_truth(path: Path) -> dict[str, float]:
    """Return the truth of a virtual experiment, the origin that the stage displaced among it."""
    record = json.loads(path.read_text("utf-8"))
    values = {name: entry["value"] for name, entry in record["values"].items()}
    return values | dict(zip(("origin_X", "origin_Y"), record["origin_error_um"], strict=True))


def variant(case_path: Path, folder: Path, tables: Mapping[str, Mapping[str, object]]) -> Path:
    """Return the same case with other keys in some of its tables; its files stay where they are."""
    case = load_case(case_path)
    stacks = {key: str(case.path(getattr(case.images, key)))
            for key in ("frames", "flats", "repeats")}  # fmt: skip
    changes: dict[str, Mapping[str, object]] = {
        "images": stacks, "history": {"file": str(case.path(case.history.file))}, **tables
    }  # fmt: skip
    for table, keys in changes.items():
        old = getattr(case, table)
        new = {**old, **keys} if isinstance(old, dict) else old.model_copy(update=dict(keys))
        case = case.model_copy(update={table: new})
    folder.mkdir(parents=True, exist_ok=True)
    write_case(case, folder / "case.toml")
    return folder / "case.toml"

"""How far a case is: its stages, the run that is at work on it, its verdict."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from time import time

from driver.case.model import Case
from driver.common.formatting import duration
from driver.results.files import DIAGNOSIS, results_of, working_folder
from driver.results.json_files import read_json
from driver.results.mesh_sizes import sized_case
from driver.results.stage_record import Done, read_record
from driver.workflow.engine import changed_inputs, stage_keys
from driver.workflow.outputs import differences
from driver.workflow.pipeline import stages
from driver.workflow.run_lock import holder


@dataclass(frozen=True)
class StageStatus:
    """How far a stage is.

    Attributes:
        name: of the stage.
        state: "done", "outdated" (done for another state of the case), "damaged" (done, and its
            results are not as it wrote them), "running", "unfinished" (it has failed, or was
            stopped or killed) or "missing".
        why: what has changed since it was done, nothing otherwise.
        seconds: how long its last run took, or how long it has been running; None for neither.
        finished: when its last run ended, in UTC; "" for none.
    """

    name: str
    state: str
    why: str = ""
    seconds: float | None = None
    finished: str = ""


@dataclass(frozen=True)
class CaseStatus:
    """How far a case is.

    Attributes:
        case: its file.
        results: the folder of its results.
        running: which process is at work on them, "" for none.
        stages: all stages, in their order.
        verdict: of the diagnosis of the case as it is, "" for none.
        text: the same in words.
    """

    case: Path
    results: Path
    running: str
    stages: tuple[StageStatus, ...]
    verdict: str = ""
    text: str = ""


def status_of(case_path: Path, results: Path | None = None) -> CaseStatus:
    """Look how far a case is; nothing is written.

    Args:
        case_path: the case file.
        results: folder of its results, None for the one that the case names.

    Raises:
        InputError: the case cannot be used, or its diagnosis cannot be read.
    """
    case = sized_case(case_path, results)
    folder = results_of(case)
    running = holder(folder)
    found = tuple(_stages(case, folder, bool(running)))
    verdict = text = ""
    if any(stage.name == "diagnose" and stage.state == "done" for stage in found):
        diagnosis = read_json(folder / DIAGNOSIS)
        verdict, text = str(diagnosis.get("verdict", "")), str(diagnosis.get("text", ""))
    return CaseStatus(case_path, folder, running, found, verdict, text)


def _stages(case: Case, folder: Path, running: bool) -> Iterator[StageStatus]:
    record, every = read_record(folder), stages(case)
    keys = stage_keys(every, case)
    for stage in every:
        entry, work = record.get(stage.name), folder / working_folder(stage.name)
        if running and work.is_dir():
            yield StageStatus(stage.name, "running", "", round(time() - work.stat().st_ctime, 1))
        elif entry is None:
            yield StageStatus(stage.name, "unfinished" if work.is_dir() else "missing")
        else:
            state, why = "done", "; ".join(" ".join(one) for one in differences(entry, folder))
            if why:
                state = "damaged"
            if entry["key"] != keys[stage.name]:
                state, why = "outdated", changed_inputs(entry, stage, case)
            yield _status(stage.name, state, why, entry)


def _status(name: str, state: str, why: str, entry: Done) -> StageStatus:
    return StageStatus(name, state, why, float(entry["seconds"]), entry.get("finished", ""))


def lines_of(status: CaseStatus) -> Iterator[str]:
    """Yield the status of a case as lines of a terminal."""
    running = f", {status.running} is at work" if status.running else ""
    yield f"{status.case}: results in {status.results}{running}"
    for stage in status.stages:
        told = f"  {stage.name:9} {stage.state:10}"
        if stage.seconds is not None:
            since = "for" if stage.state == "running" else "took"
            told += f" {since} {duration(stage.seconds)}"
        yield (told + (f", {stage.finished}" if stage.finished else "")).rstrip() + (
            f" ({stage.why})" if stage.why else ""
        )
    if status.verdict:
        yield f"verdict: {status.verdict}"
        yield status.text

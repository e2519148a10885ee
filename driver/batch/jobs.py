"""The jobs of a campaign: which calls of prismid each one makes, and what it takes."""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

from driver.batch.campaign import Campaign, Study, Trial
from driver.case.changes import changed_case, merged
from driver.case.file_names import with_file_names
from driver.case.model import CASE_FILE, SCHEMA_FILE, Case, case_text, load_case, schema_text
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence
from driver.results.files import batch_folder, batch_lock, batch_log, batch_made_from
from driver.results.hdf5 import prismid_version
from driver.virtual.settings import Virtual, read_virtual
from driver.virtual.truth import stage_program
from driver.workflow.cost import Cost
from driver.workflow.pipeline import cost_of_run

_MARK = "# Written by prismid batch; a change of the campaign writes it anew.\n"


@dataclass(frozen=True)
class Job:
    """One case of a campaign.

    Attributes:
        name: what it is called, and its log.
        case: its case file, which the first of several calls may write.
        calls: arguments of prismid, a call after the other.
        log: what the calls say.
        lock: is held as long as one of their processes lives.
        cost: of the run.
        truth: whether the truth of its experiment is known, and stands beside the case.
    """

    name: str
    case: Path
    calls: tuple[tuple[str, ...], ...]
    log: Path
    lock: Path
    cost: Cost
    truth: bool = False


def jobs_of(campaign: Campaign, file: Path) -> list[Job]:
    """Return the jobs of a campaign, and write the cases of its studies.

    Args:
        campaign: what is run.
        file: its file, beside which cases and logs of its own go.

    Raises:
        InputError: a case or a variant cannot be used, a pattern has no files, or two jobs have one
            name; each in a sentence.
    """
    jobs: list[Job] = []
    refused: list[str] = []
    sources: list[tuple[str, str | Study | Trial]] = [
        *((f"cases.{k + 1}", pattern) for k, pattern in enumerate(campaign.cases)),
        *((f"study.{k + 1}", study) for k, study in enumerate(campaign.study)),
        *((f"trial.{k + 1}", trial) for k, trial in enumerate(campaign.trial)),
    ]
    for key, source in sources:
        try:
            jobs += _jobs_of(source, key, campaign, file)
        except InputError as error:
            refused.append(str(error))
    seen: dict[str, Path] = {}
    for job in jobs:
        if job.name in seen:
            refused.append(sentence(file, "cases", f"{job.case} twice", "each case once"))
        seen[job.name] = job.case
    if refused:
        raise InputError("\n".join(refused))
    return jobs


def _jobs_of(source: str | Study | Trial, key: str, campaign: Campaign, file: Path) -> list[Job]:
    if isinstance(source, str):
        return [_of_case(path, campaign, file) for path in _cases(source, key, file)]
    if isinstance(source, Study):
        return list(_of_study(source, key, campaign, file))
    return list(_of_trial(source, campaign, file))


def _cases(pattern: str, key: str, file: Path) -> list[Path]:
    """Return the case files that a pattern names, relative to the folder of the campaign."""
    found = [Path(name) for name in sorted(glob.glob(str(file.parent / pattern), recursive=True))]
    if not found:
        raise InputError(sentence(file, key, f'no file "{pattern}"', "case files or their folders"))
    return [path / CASE_FILE if path.is_dir() else path for path in found]


def _of_case(path: Path, campaign: Campaign, file: Path) -> Job:
    """Return the job of a case; one that cannot be used fails by itself, when it is run."""
    inside = path.parent if path.name == CASE_FILE else path.with_suffix("")
    relative = os.path.relpath(inside, file.parent)
    name = path.parent.resolve().name if relative == "." else relative
    try:
        return _job(name, path, load_case(path), campaign, file)
    except (InputError, OSError):
        files = _files(file, name)
        return Job(name, path, (("run", str(path)),), *files, Cost(0.0, 0.0, 0))


def _of_study(study: Study, key: str, campaign: Campaign, file: Path) -> Iterator[Job]:
    base = load_case(file.parent / study.case)
    for values in itertools.product(*study.values.values()):
        change = dict(zip(study.values, values, strict=True))
        name = ", ".join(f"{k}={_told(value)}" for k, value in change.items())
        case = changed_case(base, _nested(change), file, f"{key}.values")
        folder = batch_folder(file) / _as_file(name)
        yield _job(name, _written(case, folder), case, campaign, file)


def _of_trial(trial: Trial, campaign: Campaign, file: Path) -> Iterator[Job]:
    path = file.parent / trial.case
    case, settings, asked = load_case(path), Virtual(), tuple[str, ...]()
    if trial.settings is not None:
        stated = file.parent / trial.settings
        settings, asked = read_virtual(stated), ("--settings", str(stated))
    cycles = settings.program.cycles
    n_images = stage_program(cycles).n_images if cycles else 0
    made_from = _digest(case_text(case), settings.model_dump_json())
    for seed in trial.seeds:
        name = f"{path.parent.resolve().name}_seed_{seed}"
        folder = batch_folder(file) / _as_file(name)
        note = batch_made_from(file, _as_file(name))
        if (folder / CASE_FILE).is_file():
            if not note.is_file() or note.read_text("utf-8") != made_from:
                found = "an experiment of another case, other settings or another prismid"
                raise InputError(sentence(folder, "folder", found, "none: move it away"))
            calls: tuple[tuple[str, ...], ...] = ()
        else:
            note.parent.mkdir(parents=True, exist_ok=True)
            write_whole(note, made_from)
            calls = (("virtual", str(path), "--to", str(folder), "--seed", str(seed), *asked),)
        made = folder / CASE_FILE
        yield _job(name, made, case, campaign, file, calls, n_images, truth=True)


def _job(
    name: str,
    path: Path,
    case: Case,
    campaign: Campaign,
    file: Path,
    before: tuple[tuple[str, ...], ...] = (),
    n_images: int = 0,
    truth: bool = False,
) -> Job:
    use = campaign.execution
    last = campaign.until
    if not case.with_images and last in ("measure", "diagnose", "advise"):
        last = "identify"
    run = (
        "run", str(path), "--until", last,
        "--processes", str(use.processes), "--threads", str(use.threads),
    )  # fmt: skip
    cost = cost_of_run(case, use.processes, use.threads, n_images)
    return Job(name, path, (*before, run), *_files(file, name), cost, truth)


def _files(file: Path, name: str) -> tuple[Path, Path]:
    """Return the log of a job and its lock."""
    return batch_log(file, _as_file(name)), batch_lock(file, _as_file(name))


def _written(case: Case, folder: Path) -> Path:
    """Write a variant of a case, which reads the files of that; one that is there stays.

    Raises:
        InputError: there is a case that no campaign wrote.
    """
    path = folder / CASE_FILE
    above = os.path.relpath(case.path("").resolve(), folder.resolve())

    def renamed(name: str) -> str:
        return name if Path(name).is_absolute() else f"{above}/{name}"

    text = _MARK + case_text(with_file_names(case, renamed))
    there = path.read_text("utf-8") if path.is_file() else None
    if there is not None and not there.startswith(_MARK):
        found = "a case that no campaign wrote"
        raise InputError(sentence(path, "file", found, "none: move it away"))
    if there != text:
        folder.mkdir(parents=True, exist_ok=True)
        write_whole(folder / SCHEMA_FILE, schema_text())
        write_whole(path, text)
    return path


def _nested(change: Mapping[str, Any]) -> dict[str, Any]:
    """Return dotted keys as nested tables."""
    tables = [
        reduce(lambda below, name: {name: below}, reversed(key.split(".")), value)
        for key, value in change.items()
    ]
    whole: dict[str, Any] = reduce(merged, tables, {})
    return whole


def _told(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _as_file(name: str) -> str:
    """Return a name as a file can have it on every system."""
    kept = "".join(c if c.isalnum() or c in "._-+=" else "_" for c in name)
    # Names that differ by other characters alone, or are too long for a file, stay apart.
    return kept if kept == name else f"{kept[:80]}-{_digest(name)[:8]}"


def _digest(*parts: str) -> str:
    return hashlib.sha256(json.dumps([prismid_version(), *parts]).encode()).hexdigest()


def most_at_a_time(jobs: Sequence[Job], campaign: Campaign, cores: int, memory: float) -> int:
    """Jobs that run at a time: those asked for, else as many as the cores hold.

    No more than the memory holds, but one.

    Args:
        jobs: the jobs.
        campaign: what is run.
        cores: of the machine.
        memory: of the machine [bytes].
    """
    use = campaign.execution
    asked = use.jobs or max(1, cores // (use.processes * use.threads))
    stated = memory if use.memory_GB is None else 1e9 * use.memory_GB
    largest = max((job.cost.memory for job in jobs), default=0.0)
    held = int(stated // largest) if largest else asked
    return max(1, min(asked, held, len(jobs)))

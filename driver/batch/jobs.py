"""The jobs of a campaign: which calls of prismid each one makes, and what it takes."""

from __future__ import annotations

import glob
import hashlib
import itertools
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import Any

from driver.batch.campaign import Campaign, Study, Trial
from driver.case.changes import changed_case, merged
from driver.case.file_names import read_from
from driver.case.model import CASE_FILE, SCHEMA_FILE, Case, case_text, load_case, schema_text
from driver.case.scheduler import KEY
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence, show
from driver.results.files import (
    BATCH,
    RESULTS,
    TRUTH_SETTINGS,
    batch_folder,
    batch_lock,
    batch_log,
    batch_made_from,
    batch_truth,
    results_of,
)
from driver.results.hdf5 import prismid_version
from driver.results.mesh_sizes import sized_case
from driver.virtual.settings import Virtual, read_virtual
from driver.virtual.truth import stage_program
from driver.workflow.cost import Cost
from driver.workflow.engine import finished
from driver.workflow.pipeline import cores_of_run, cost_of_run, stages

_MARK = "# Written by prismid batch; a change of the campaign writes it anew.\n"
_LONGEST = 100  # bytes of the name of a file
_NOTHING = Cost(0.0, 0.0, 0)


class _OwnWorkersError(InputError):
    """A case that names workers, in a campaign that has some."""


@dataclass(frozen=True)
class Job:
    """One case of a campaign.

    Attributes:
        name: what it is called, and its log.
        key: what of the campaign it is from.
        case: its case file, which the first of several calls may write.
        calls: arguments of prismid, a call after the other.
        until: name of the last stage.
        log: what the calls say.
        lock: is held as long as one of their processes lives.
        cost: of what is not done yet.
        cores: that it takes at a time.
        texts: files that the campaign writes before it begins, and what they hold.
        made: the folder of a virtual experiment that is to be made, or None.
    """

    name: str
    key: str
    case: Path
    calls: tuple[tuple[str, ...], ...]
    until: str
    log: Path
    lock: Path
    cost: Cost
    cores: int = 1
    texts: tuple[tuple[Path, str], ...] = ()
    made: Path | None = None


def jobs_of(campaign: Campaign, file: Path) -> list[Job]:
    """Return the jobs of a campaign; nothing is written.

    Args:
        campaign: what is run.
        file: its file, beside which cases and logs of its own go.

    Raises:
        InputError: a case or a variant cannot be used, a pattern has no files, or two jobs have one
            name or the same results; each in a sentence.
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
        except OSError as error:
            refused.append(sentence(file, key, str(error), "files that can be read"))
    refused += _twice(jobs, file)
    if refused:
        raise InputError("\n".join(dict.fromkeys(refused)))
    return jobs


def _twice(jobs: Sequence[Job], file: Path) -> Iterator[str]:
    """Tell which jobs have the name or the results of another one."""
    names: dict[str, Job] = {}
    places: dict[Path, Job] = {}
    for job in jobs:
        place = results_at(job.case).resolve()
        other = names.get(job.name) or places.get(place)
        if other is not None:
            found = f"{job.case}, which has the name or the results of {other.case} ({other.key})"
            yield sentence(file, job.key, found, "each case once, in a folder of its own")
        names.setdefault(job.name, job)
        places.setdefault(place, job)


def results_at(path: Path) -> Path:
    """Return the folder of the results of a case; the usual one of a case that cannot be used."""
    try:
        return results_of(load_case(path))
    except (InputError, OSError):
        return path.parent / RESULTS


def _jobs_of(source: str | Study | Trial, key: str, campaign: Campaign, file: Path) -> list[Job]:
    if isinstance(source, str):
        return [_of_case(path, key, campaign, file) for path in _cases(source, key, file)]
    if isinstance(source, Study):
        return _of_study(source, key, campaign, file)
    return list(_of_trial(source, key, campaign, file))


def _cases(pattern: str, key: str, file: Path) -> list[Path]:
    """Return the case files that a pattern names, relative to the folder of the campaign.

    Of what a wildcard takes in, those are left out that are no case, or that a campaign made.
    """
    if (file.parent / pattern).exists():
        return [_case_file(file.parent / pattern)]
    found = glob.glob(pattern, root_dir=file.parent, recursive=True)
    paths = [_case_file(file.parent / name) for name in sorted(found)]
    cases = [
        path
        for path in paths
        if path.suffix == Path(CASE_FILE).suffix
        and path.is_file()
        and path.resolve() != file.resolve()
        and not any(folder.endswith(BATCH) or folder == RESULTS for folder in path.parts[:-1])
    ]
    if not cases:
        raise InputError(sentence(file, key, f'no case "{pattern}"', "case files or their folders"))
    return list(dict.fromkeys(cases))


def _case_file(path: Path) -> Path:
    return path / CASE_FILE if path.is_dir() else path


def _of_case(path: Path, key: str, campaign: Campaign, file: Path) -> Job:
    """Return the job of a case; one that cannot be used fails by itself, when it is run.

    So does one at which prismid has a fault, which its run tells with a traceback.
    """
    name = _name(path, file)
    try:
        return _job(name, key, path, load_case(path), campaign, file)
    except _OwnWorkersError:
        raise
    except Exception:
        calls = (("run", str(path), "--until", campaign.until),)
        return Job(name, key, path, calls, campaign.until, *_files(file, name), _NOTHING)


def _name(path: Path, file: Path) -> str:
    """Return what a case is called: its folder, or its file where that has a name of its own."""
    inside = path.parent if path.name == CASE_FILE else path
    relative = os.path.relpath(inside, file.parent)
    return _printable(path.parent.resolve().name if relative == "." else relative)


def _of_study(study: Study, key: str, campaign: Campaign, file: Path) -> list[Job]:
    """Return the variants of a case; all that is wrong with any of them is told at once."""
    path, where = _case_file(file.parent / study.case), Path(f"{file}: {key}.values")
    base = load_case(path)
    refused = [
        sentence(file, f"{key}.values", f'"{one}" beside "{other}"', "keys that hold no other")
        for one, other in itertools.permutations(study.values, 2)
        if other.startswith(f"{one}.")
    ]
    refused += [
        sentence(file, f"{key}.values.{name}", f"{show(value)} twice", "each value once")
        for name, values in study.values.items()
        for k, value in enumerate(values)
        if value in values[:k]
    ]
    if refused:
        raise InputError("\n".join(refused))
    jobs = []
    for values in itertools.product(*study.values.values()):
        change = dict(zip(study.values, values, strict=True))
        told = ", ".join(f"{k}={_told(value)}" for k, value in change.items())
        name = f"{_name(path, file)} {_printable(told)}"
        folder = batch_folder(file) / _as_file(name)
        try:
            case = changed_case(base, _nested(change), where, told)
            texts = _copied(case, folder)
            job = _job(name, key, folder / CASE_FILE, case, campaign, file)
            jobs.append(replace(job, texts=texts))
        except InputError as error:
            refused += str(error).splitlines()
    if refused:
        raise InputError("\n".join(dict.fromkeys(refused)))
    return jobs


def _of_trial(trial: Trial, key: str, campaign: Campaign, file: Path) -> Iterator[Job]:
    """Return virtual experiments, made from copies of case and settings as they are now."""
    path = _case_file(file.parent / trial.case)
    case, settings, stated = load_case(path), Virtual(), ""
    name = _name(path, file)
    if trial.settings is not None:
        settings = read_virtual(file.parent / trial.settings)
        stated = (file.parent / trial.settings).read_text("utf-8")
        name += f" {_printable(Path(trial.settings).stem)}"
    cycles = settings.program.cycles
    n_images = stage_program(cycles).n_images if cycles else 0
    made_from = _digest(prismid_version(), case_text(case), settings.model_dump_json())
    copy = batch_truth(file, made_from[:12])
    texts = (*_copied(case, copy), (copy / TRUTH_SETTINGS, stated))
    for seed in trial.seeds:
        whole = f"{name} seed {seed}"
        folder = batch_folder(file) / _as_file(whole)
        note, made = batch_made_from(file, _as_file(whole)), folder / CASE_FILE
        if made.is_file():
            if not note.is_file() or note.read_text("utf-8") != made_from:
                found = "an experiment of another case, other settings or another prismid"
                raise InputError(sentence(folder, "folder", found, "none: move it away"))
            yield _job(whole, key, made, case, campaign, file, n_images=n_images)
            continue
        call = (
            "virtual", str(copy / CASE_FILE), "--to", str(folder), "--seed", str(seed),
            "--settings", str(copy / TRUTH_SETTINGS),
        )  # fmt: skip
        job = _job(whole, key, made, case, campaign, file, (call,), n_images)
        yield replace(job, texts=(*texts, (note, made_from)), made=folder)


def _job(
    name: str,
    key: str,
    path: Path,
    case: Case,
    campaign: Campaign,
    file: Path,
    before: tuple[tuple[str, ...], ...] = (),
    n_images: int = 0,
) -> Job:
    use, names = campaign.execution, [stage.name for stage in stages(case)]
    if case.execution.scheduler is not None and (use.scheduler or campaign.cluster):
        # A worker that waits for tasks of its own does none.
        found = f'"{case.execution.scheduler}" in a case of a campaign that has workers of its own'
        raise _OwnWorkersError(sentence(path, KEY, found, "the key in one of both"))
    # Without images there are fewer stages.
    last = campaign.until if campaign.until in names else "identify"
    run = (
        "run", str(path), "--until", last,
        "--processes", str(use.processes), "--threads", str(use.threads),
        *(() if use.store is None else ("--store", str(store_of(use.store, file)))),
    )  # fmt: skip
    cost = cost_of_run(case, use.processes, use.threads, n_images)
    if not before and last in stages_done(path):
        cost = replace(cost, seconds=0.0)
    cores = cores_of_run(case, use.processes, use.threads)
    return Job(name, key, path, (*before, run), last, *_files(file, name), cost, cores)


def store_of(store: str, file: Path) -> Path:
    """Return the folder of the jobs of solvers that a campaign names."""
    return Path(os.path.abspath(file.parent / store))


def stages_done(path: Path) -> frozenset[str]:
    """Names of the stages that are done for a case as it is; none for one that cannot be used."""
    if not path.is_file():
        return frozenset()
    try:
        case = sized_case(path)
        return finished(case, stages(case), ())
    except InputError:
        return frozenset()


def _files(file: Path, name: str) -> tuple[Path, Path]:
    """Return the log of a job and its lock."""
    return batch_log(file, _as_file(name)), batch_lock(file, _as_file(name))


def _copied(case: Case, folder: Path) -> tuple[tuple[Path, str], ...]:
    """Return a case in another folder, as files and texts; it reads the files of that case.

    Raises:
        InputError: there is a case that no campaign wrote.
    """
    path = folder / CASE_FILE
    if path.is_file() and not path.read_text("utf-8").startswith(_MARK):
        found = "a case that no campaign wrote"
        raise InputError(sentence(path, "file", found, "none: move it away"))
    text = _MARK + case_text(read_from(case, folder))
    return (folder / SCHEMA_FILE, schema_text()), (path, text)


def write_files(jobs: Sequence[Job]) -> None:
    """Write the cases of studies and what trials are made from; what is there already stays.

    Args:
        jobs: of the campaign.
    """
    for job in jobs:
        for path, text in job.texts:
            if not path.is_file() or path.read_text("utf-8") != text:
                path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(path, text)


def _nested(change: Mapping[str, Any]) -> dict[str, Any]:
    """Return dotted keys as nested tables."""
    tables = [
        reduce(lambda below, name: {name: below}, reversed(key.split(".")), value)
        for key, value in change.items()
    ]
    whole: dict[str, Any] = reduce(merged, tables, {})
    return whole


def _told(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)


def _printable(name: str) -> str:
    """Return a name without what a terminal or a table would not show."""
    return "".join(c if c.isprintable() else "�" for c in name)


def _as_file(name: str) -> str:
    """Return a name as a file can have it on every system."""
    kept = "".join(c if c.isalnum() or c in "._-+=, " else "_" for c in name)
    if kept.startswith("."):  # hidden from who lists the folder
        kept = "_" + kept[1:]
    if kept == name and len(kept.encode()) <= _LONGEST:
        return kept
    # Names that differ by other characters alone, or are too long for a file, stay apart.
    short = kept.encode()[: _LONGEST - 9].decode(errors="ignore")
    return f"{short}-{_digest(name)[:8]}"


def _digest(*parts: str) -> str:
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


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
    asked = use.jobs or max(1, cores // max((job.cores for job in jobs), default=1))
    stated = memory if use.memory_GB is None else 1e9 * use.memory_GB
    largest = max((job.cost.memory for job in jobs), default=0.0)
    held = int(stated // largest) if largest else asked
    return max(1, min(asked, held, len(jobs)))

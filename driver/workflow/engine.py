"""Stages of a run: each is done once for its inputs, and its results appear whole or not at all."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from shlex import quote
from typing import Any

from driver.case.model import Case
from driver.case.values import Table
from driver.common.atomic_write import place_below
from driver.common.errors import InputError, sentence
from driver.common.machine import computed_by
from driver.common.parallel import blas_on_one_thread, processes_kept
from driver.common.remaining import at_work, left_of_run
from driver.experiment.images.files import split_dataset
from driver.experiment.orientations import map_files
from driver.parameters.user_terms import files_of_terms, installed_terms
from driver.results.files import (
    kept_folder,
    kept_response,
    make_folder,
    present,
    remove_folder,
    results_of,
    working_folder,
)
from driver.results.stage_record import (
    Done,
    case_from,
    read_record,
    refuse_another_case,
    write_record,
)
from driver.workflow.outputs import (
    UNREADABLE,
    are_readable,
    content_hash,
    differences,
    set_edited_aside,
)
from driver.workflow.run_lock import sole_run
from solver_adapters.interface import SolverError

logger = logging.getLogger(__name__)

_VERSION = "version"
_NOTHING = hashlib.sha256().hexdigest()


class StageError(InputError):
    """A stage that cannot be run: what was found and what was expected."""


@dataclass(frozen=True)
class StageContext:
    """What a stage works with.

    Attributes:
        case: the case.
        results: the folder of the finished results of all stages.
        workdir: an empty folder; every file left in it becomes a result of the stage.
        prepare_only: whether external solvers write their jobs for another machine.
        kept: folder of what is kept against an interruption until the stage ends, or None.
        memory: what stages of one run have read and leave to later ones, by name.
    """

    case: Case
    results: Path
    workdir: Path
    prepare_only: bool = False
    kept: Path | None = None
    memory: dict[str, Any] = field(default_factory=dict)

    def result(self, name: str) -> Path:
        """Return a result of an earlier stage.

        Raises:
            AbsentError: there is no such file.
        """
        return present(self.results, name)


def _no_files(case: Case) -> Sequence[Path]:
    return ()


@dataclass(frozen=True)
class Stage:
    """One stage of a run.

    Attributes:
        name: as it is called on the command line and in the record.
        version: revision of its code; a new one makes old results stale.
        sections: tables of the case file on which its results depend.
        run: does the work and writes its results into `StageContext.workdir`.
        files: the files (folders, patterns) that it reads beside the case.
        left_out: keys of these tables on which its results do not depend, by table.
        alone: whether it reads no results of the stages before it.
        reads_on: whether it reads its files again and again until it ends.
    """

    name: str
    version: str
    sections: tuple[str, ...]
    run: Callable[[StageContext], None]
    files: Callable[[Case], Sequence[Path]] = field(default=_no_files)
    left_out: Mapping[str, Collection[str]] = field(default_factory=dict)
    alone: bool = False
    reads_on: bool = False


def meshed_files(case: Case) -> tuple[Path, ...]:
    """Return the mesh of the user's own, or the label image or map, where a case names one."""
    names = case.specimen.mesh_file, case.specimen.labels
    return tuple(Path(split_dataset(case.path(name))[0]) for name in names if name is not None)


def measured_files(case: Case) -> tuple[Path, ...]:
    """Return the images, the history and the meshes that a case names."""
    images, dic, meshed = case.images, case.dic, meshed_files(case)
    if not case.with_images:
        return (*meshed, case.path(case.history.file))
    names = (
        images.frames, images.flats, images.repeats, images.mask, images.noise_map,
        case.history.file,
        *(mesh for mesh in (dic.mesh, dic.height_mesh) if mesh != "trace"),
    )  # fmt: skip
    named = (Path(split_dataset(case.path(name))[0]) for name in names if name is not None)
    return (*meshed, *named)


def reported_files(case: Case) -> tuple[Path, ...]:
    """Return what a report reads: the measured files, and the EBSD maps."""
    return (*measured_files(case), *map_files(case))


def identified_files(case: Case) -> tuple[Path, ...]:
    """Return what an identification reads: what a report does, and the terms that it frees."""
    return (*reported_files(case), *files_of_terms(case.extensions))


def diagnosed_files(case: Case) -> tuple[Path, ...]:
    """Return what a diagnosis reads: the measured files, and causes and terms of the user's own."""
    own = files_of_terms(term.parameter.name for term in installed_terms())
    return (*measured_files(case), *own, *(case.path(name) for name in case.diagnosis.cause_files))


def _as_it_is(case: Case, done: str) -> Case | None:
    return None


def _as_it_failed(case: Case, error: SolverError) -> Case | None:
    return None


def run_stages(
    case: Case,
    stages: Sequence[Stage],
    until: str | None = None,
    force: bool = False,
    prepare_only: bool = False,
    refined: Callable[[Case, str], Case | None] = _as_it_is,
    coarser: Callable[[Case, SolverError], Case | None] = _as_it_failed,
) -> None:
    """Run the stages in their order, leaving out those that are done and unchanged.

    A stage is left out if its key is that of its last run and its results are there as it wrote
    them. The key is a hash of the version of its code, its tables of the case, the content of its
    files and the key of the stages before it. Results are written aside and moved into `results/`,
    beside the case, once the stage has ended; a stage that fails leaves the results of its last
    run, and what somebody has edited since is kept under another name. The simulations that a
    stage has ended before it was interrupted are taken up by the next run.

    Args:
        case: the case.
        stages: all stages, each building on the ones before it.
        until: name of the last stage to run, None for all.
        force: run the stages even if they are done and unchanged, and take nothing up.
        prepare_only: whether external solvers write their jobs for another machine.
        refined: what is asked with the name of each stage that is done: the case in another state,
            for which the stages begin anew, or None.
        coarser: what is asked where a stage cannot be simulated, the same; None ends the run.

    Raises:
        PreparedError: such jobs were written.
        SolverError: a stage could not be simulated.
        BusyError: another run is at work on the results.
        InputError: they are those of another case.
        StageError: there is no stage of the name `until`, or two results have one name.
    """
    names = [stage.name for stage in stages]
    if until is not None and until not in names:
        raise StageError(f'--until: found "{until}", expected one of {", ".join(names)}')
    results = results_of(case)
    make_folder(results, case.file)
    last = len(names) if until is None else names.index(until) + 1
    memory, forced = dict[str, Any](), set(names) if force else set()
    with sole_run(results):
        refuse_another_case(results, case)
        state: Case | None = case
        while state is not None:
            case, state, before = state, None, ""
            for stage in stages[:last]:
                inputs = stage_inputs(stage, case)
                key, before = _chained(stage, inputs, before)
                entry = read_record(results).get(stage.name)
                if stage.name not in forced and _stands(stage, entry, key, results):
                    logger.info(f"{stage.name}: done and unchanged")
                else:
                    _refuse_folders(entry, results)
                    if stage.name in forced:
                        remove_folder(results / kept_folder(stage.name))
                    try:
                        _run_stage(stage, case, results, key, inputs, prepare_only, memory)
                    except SolverError as error:
                        state = coarser(case, error)
                        if state is None:
                            raise
                        break
                forced.discard(stage.name)
                state = refined(case, stage.name)
                if state is not None:
                    break


def stage_keys(stages: Sequence[Stage], case: Case) -> dict[str, str]:
    """SHA-256 of all on which the results of each stage depend, by its name."""
    keys: dict[str, str] = {}
    before = ""
    for stage in stages:
        keys[stage.name], before = _chained(stage, stage_inputs(stage, case), before)
    return keys


def stage_key(stage: Stage, case: Case, key_before: str) -> str:
    """SHA-256 of all on which the results of a stage depend."""
    return _key(stage, stage_inputs(stage, case), key_before)


def _chained(stage: Stage, inputs: dict[str, str], before: str) -> tuple[str, str]:
    """Return the key of a stage, and that of all stages so far."""
    if not stage.alone:
        key = _key(stage, inputs, before)
        return key, key
    key = _key(stage, inputs, "")
    return key, _hash([before, key])


def _key(stage: Stage, inputs: dict[str, str], key_before: str) -> str:
    # Contents alone: the name of a file depends on how the case was named and where it lies.
    return _hash([stage.name, *inputs.values(), key_before])


def stage_inputs(stage: Stage, case: Case) -> dict[str, str]:
    """Return what a stage reads beside the results of earlier ones, by name, with a hash each."""
    # How a program is called changes no result.
    left_out = {table: set(keys) for table, keys in stage.left_out.items()}
    tables = case.model_dump(
        mode="json", include=set(stage.sections), exclude={"solver": {"profiles"}} | left_out
    )
    return (
        {_VERSION: stage.version}
        | {f"[{name}]": _hash(_stated(getattr(case, name), keys)) for name, keys in tables.items()}
        | {_name_of(path, case): content_hash(path) for path in stage.files(case)}
    )


def _stated(table: Any, keys: Any) -> Any:
    """Return the keys of a table without those that came later and stand at their defaults."""
    if not isinstance(table, Table):
        return keys
    fields = type(table).model_fields
    silent = {key for key in table.added if getattr(table, key) == fields[key].default}
    return {key: value for key, value in keys.items() if key not in silent}


def _name_of(path: Path, case: Case) -> str:
    """Return the path of a file as the case may name it: a case and its files may be moved."""
    folder = case.file.parent
    return str(path.relative_to(folder) if path.is_relative_to(folder) else path)


def changed_inputs(entry: Done, stage: Stage, case: Case) -> str:
    """Say what has changed since a stage has run."""
    if _VERSION not in entry.get("inputs", {}):
        return "of another version of prismid"
    then, now = entry["inputs"], stage_inputs(stage, case)
    gone = [name for name in then if name not in now]
    changed = [name for name in now if then.get(name) != now[name]]
    if not changed and not gone:
        return "an earlier stage has changed"
    if _VERSION in changed:
        return f"of version {then[_VERSION]} of this stage, which has {now[_VERSION]}"
    states = {UNREADABLE: "cannot be read", _NOTHING: "is empty or not there"}
    said = [f"{name} {states.get(now[name], 'has changed')}" for name in changed]
    return "; ".join([*said, *(f"{name} is read no more" for name in gone)])


def _hash(content: object) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _run_stage(
    stage: Stage,
    case: Case,
    results: Path,
    key: str,
    inputs: dict[str, str],
    prepare_only: bool,
    memory: dict[str, Any],
) -> None:
    workdir = results / working_folder(stage.name)
    remove_folder(workdir)
    workdir.mkdir()
    kept = results / kept_folder(stage.name)
    if kept.is_symlink():
        remove_folder(kept)
    logger.info(f"{stage.name}: started")
    if there := len(list(kept.glob(kept_response(Path(), "*").name))):
        what = "a simulation" if there == 1 else f"{there} simulations"
        logger.info(f"  {what} of an interrupted run are kept: those that come again are taken up")
    start = time.perf_counter()
    with at_work(stage.name), blas_on_one_thread(), processes_kept():
        stage.run(StageContext(case, results, workdir, prepare_only, kept, memory))
    seconds = time.perf_counter() - start
    if stage.reads_on:
        _refuse_other_files(stage, case, inputs)
    outputs = sorted(
        str(path.relative_to(workdir)) for path in workdir.rglob("*") if path.is_file()
    )
    done = read_record(results)
    old = done.pop(stage.name, None)
    for other, entry in done.items():
        shared = set(outputs) & set(entry["outputs"])
        if shared:
            raise StageError(
                f"{stage.name}: found a result {min(shared)}, which belongs to {other}, "
                "expected another name"
            )
    for told in set_edited_aside(old, results):
        logger.info(told)
    # Until the record is written anew, a stage whose files are being replaced counts as not done.
    write_record(results, done)
    for name in outputs:
        place = place_below(results, name)
        place.parent.mkdir(parents=True, exist_ok=True)
        os.replace(workdir / name, place)
    for name in set(old["outputs"] if old else ()) - set(outputs):
        place_below(results, name).unlink(missing_ok=True)
    done[stage.name] = {
        "key": key,
        "inputs": inputs,
        "outputs": outputs,
        "digests": {name: content_hash(results / name) for name in outputs},
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(seconds, 2),
        "case": case_from(results, case),
        "machine": computed_by(case.execution.processes, case.execution.threads),
    }
    write_record(results, done)
    shutil.rmtree(workdir)
    remove_folder(kept)
    logger.info(f"{stage.name}: finished in {seconds:.1f} s")
    if left := left_of_run():
        logger.info(f"  {left}")


def _refuse_other_files(stage: Stage, case: Case, inputs: dict[str, str]) -> None:
    """Refuse results of files that are not those of which the key of the stage was made.

    Raises:
        StageError: one has changed while the stage read it.
    """
    for path in stage.files(case):
        if content_hash(path) != inputs[_name_of(path, case)]:
            found, expected = f"another content than as {stage.name} began", "the same: run again"
            raise StageError(sentence(path, "file", found, expected))


def is_done(entry: Done | None, key: str, results: Path) -> bool:
    """Whether a stage has run with a key, and others can read its results."""
    return entry is not None and entry["key"] == key and are_readable(entry, results)


def _stands(stage: Stage, entry: Done | None, key: str, results: Path) -> bool:
    """Whether a stage has run with a key, and all its results are as it wrote them; tell if not."""
    if entry is None or entry["key"] != key:
        return False
    found = list(differences(entry, results))
    for name, state in found:
        logger.info(f"{stage.name}: {name} {state}: it is made anew")
    return not found


def finished(
    case: Case,
    stages: Sequence[Stage],
    needed: Collection[str],
    refuse: type[InputError] = StageError,
) -> frozenset[str]:
    """Names of the stages that are done for the case as it is.

    Args:
        case: the case.
        stages: all its stages, in their order.
        needed: names of those without which nothing can be done.
        refuse: the error that is raised.

    Raises:
        InputError: one of them has no results, or such as are of another state or damaged.
    """
    results = results_of(case)
    record, done = read_record(results), set()
    keys = stage_keys(stages, case)
    for stage in stages:
        entry = record.get(stage.name)
        if is_done(entry, keys[stage.name], results):
            done.add(stage.name)
        elif stage.name in needed:
            there = entry is not None and is_done(entry, entry["key"], results)
            state = "no results, or damaged ones"
            if there and entry is not None:
                state = f"results of another state ({changed_inputs(entry, stage, case)})"
            last = [name for name in (s.name for s in stages) if name in needed][-1]
            run = f"prismid run {quote(str(case.file))}"
            raise refuse(
                sentence(
                    results, f"stage {stage.name}", state,
                    f"those of the case as it is (`{run} --until {last}` makes them)",
                )
            )  # fmt: skip
    return frozenset(done)


def _refuse_folders(entry: Done | None, results: Path) -> None:
    """Refuse a folder or a link where a result goes before it is computed, not after."""
    for name in entry["outputs"] if entry else ():
        if place_below(results, name).is_dir():
            raise StageError(
                sentence(results / name, "result", "a folder", "a file, or nothing: move it away")
            )

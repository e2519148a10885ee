"""`prismid verify`: compute stored results anew, elsewhere, and compare every number of them."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from rich.table import Table

from driver.case.file_names import with_file_names
from driver.case.model import CASE_FILE, Case, load_case, write_case
from driver.common.errors import InputError, sentence
from driver.common.formatting import cost_told, duration
from driver.common.machine import computed_by
from driver.results.files import SIZES, STAGES, make_folder, results_of
from driver.results.mesh_sizes import sized_case
from driver.results.stage_record import Done, Record, read_record
from driver.verify.comparison import TOLERANCE, Comparison, compared
from driver.verify.numbers import FORMATS, numbers_of
from driver.workflow.engine import Stage, changed_inputs, run_stages, stage_keys
from driver.workflow.outputs import content_hash
from driver.workflow.pipeline import cost_of_run, stages
from solver_adapters.kernels import use_threads

logger = logging.getLogger(__name__)

_TOLD = 20  # arrays that differ, and are named


class VerifyError(InputError):
    """Results that cannot be computed anew: what was found and what was expected."""


@dataclass(frozen=True)
class VerifiedFile:
    """A stored result beside the one that was computed anew.

    Attributes:
        stage: that writes it.
        name: of the file.
        comparison: of both; None where one of them is not there, or cannot be read.
        fault: what is wrong with the stored file itself, "" for nothing.
    """

    stage: str
    name: str
    comparison: Comparison | None
    fault: str = ""

    def agrees(self, to_the_last_digit: bool) -> bool:
        """Whether the file is whole, and its numbers are those that were computed."""
        compared_well = self.comparison is None or self.comparison.agrees(to_the_last_digit)
        return not self.fault and compared_well


@dataclass(frozen=True)
class Verification:
    """What became of stored results that were computed anew.

    Attributes:
        results: the folder of the stored results.
        files: the files that were compared.
        same_machine: whether they come from this machine, with the same libraries and threads.
    """

    results: Path
    files: tuple[VerifiedFile, ...]
    same_machine: bool

    @property
    def agrees(self) -> bool:
        """Whether every file agrees."""
        return all(file.agrees(self.same_machine) for file in self.files)


def case_file(where: Path) -> Path:
    """Return the case file of what was given: a case, its folder or the folder of its results.

    Raises:
        VerifyError: there is no case file beside the results.
    """
    if not where.is_dir():
        return where
    if not (where / STAGES).is_file():
        return where / CASE_FILE
    path = where.parent / CASE_FILE
    if not path.is_file():
        remedy = "the case of these results: name it, and them by --results"
        raise VerifyError(sentence(path, "file", "nothing", remedy))
    return path


def verify(where: Path, until: str | None = None, results: Path | None = None) -> Verification:
    """Compute the stored results of a case anew in a temporary folder, and compare them.

    Nothing among the stored results is changed. Jobs of solvers that are programs of their own are
    run anew, too. Meshes of automatic sizes have those that the stored run came to.

    Args:
        where: a case file, its folder, or the folder of its results.
        until: name of the last stage to compute, None for all that have results.
        results: folder of the results of a case, None for the one that the case names.

    Raises:
        InputError: the case has no results as it is, or cannot be computed.
        SolverError: a simulation could not be finished.
    """
    stored = where if results is None and (where / STAGES).is_file() else results
    case = sized_case(case_file(where), stored)
    results = results_of(case)
    record = read_record(results)
    chosen = _with_results(case, record, until)
    use_threads(case.execution.processes * case.execution.threads)
    cost = cost_of_run(case, case.execution.processes, case.execution.threads)
    logger.info(f"all stages take {cost_told(cost.seconds, cost.memory)}")
    taken = sum(record[stage.name]["seconds"] for stage in chosen)
    logger.info(f"those up to {chosen[-1].name} took {duration(taken)} when they were stored")
    here = computed_by(case.execution.processes, case.execution.threads)
    same_machine = all(record[stage.name].get("machine") == here for stage in chosen)
    with TemporaryDirectory(prefix="prismid-verify-") as name:
        again = _moved(case, Path(name))
        run_stages(again, stages(again), chosen[-1].name)
        if read_record(results) != record:
            replaced, expected = "a run that replaces results", "one that has ended: verify again"
            raise VerifyError(sentence(results, STAGES, replaced, expected))
        files = tuple(
            file
            for stage in chosen
            for file in _compared_files(stage.name, record[stage.name], results, results_of(again))
        )
    return Verification(results, files, same_machine)


def _with_results(case: Case, record: Record, until: str | None) -> Sequence[Stage]:
    """Return the stages from the first on that have results of the case as it is.

    Raises:
        VerifyError: the first has none, or the one that was asked for; there is no such stage.
    """
    every = stages(case)
    names = [stage.name for stage in every]
    if until is not None and until not in names:
        raise VerifyError(f'--until: found "{until}", expected one of {", ".join(names)}')
    keys, chosen = stage_keys(every, case), list[Stage]()
    for stage in every[: len(names) if until is None else names.index(until) + 1]:
        entry = record.get(stage.name)
        if entry is None or entry["key"] != keys[stage.name]:
            state = "no results"
            if entry is not None:
                state = f"results of another state ({changed_inputs(entry, stage, case)})"
            if not chosen or until is not None:
                remedy = f"those of the case as it is (`prismid run {case.file}` makes them)"
                raise VerifyError(sentence(results_of(case), f"stage {stage.name}", state, remedy))
            logger.info(f"{stage.name}: {state}: not compared")
            break
        chosen.append(stage)
    # A stage that only draws has nothing to compare, and need not be computed.
    while until is None and len(chosen) > 1 and not _numeric(record[chosen[-1].name]):
        del chosen[-1]
    return chosen


def _numeric(entry: Done) -> list[str]:
    """Names of the results of a stage that hold numbers."""
    return [name for name in entry["outputs"] if Path(name).suffix in FORMATS]


def _moved(case: Case, folder: Path) -> Case:
    """Write the case into another folder, where it reads the same files; return it."""
    there = load_case(case.file)
    path = folder / CASE_FILE
    named = with_file_names(there, lambda name: os.path.abspath(case.path(name)))
    write_case(named.with_values_at({"execution.store": None}), path)
    moved = load_case(path)
    make_folder(results_of(moved), path)
    stored = results_of(case) / SIZES
    if stored.is_file():
        (results_of(moved) / SIZES).write_bytes(stored.read_bytes())
    return sized_case(path)


def _compared_files(
    stage: str, entry: Done, stored: Path, computed: Path
) -> Iterator[VerifiedFile]:
    made = {str(path.relative_to(computed)): path for path in computed.rglob("*") if path.is_file()}
    for name in _numeric(entry):
        logger.info(f"compared: {name}")
        path, digest = stored / name, entry.get("digests", {}).get(name)
        if not path.is_file():
            yield VerifiedFile(stage, name, None, "is not there")
            continue
        whole = digest in (None, content_hash(path))
        fault = "" if whole else "has changed since its stage wrote it"
        if name not in made:
            yield VerifiedFile(stage, name, None, fault or "is not written any more")
            continue
        rounding = FORMATS[path.suffix].rounding
        now = numbers_of(made[name])
        try:
            then = numbers_of(path)
        except InputError:
            yield VerifiedFile(stage, name, None, "cannot be read")
            continue
        yield VerifiedFile(stage, name, compared(then, now, rounding), fault)


def table_of(found: Verification) -> Table:
    """Return the files, how much of each is the same, and the largest difference."""
    table = Table(
        "stage",
        "file",
        "numbers",
        "same digits",
        "largest difference",
        "",
        box=None,
        pad_edge=False,
    )
    for file in found.files:
        both = file.comparison
        numbers = ("", "", "") if both is None else (
            str(both.count), str(both.same), _size(both.largest),
        )  # fmt: skip
        state = "agrees" if file.agrees(found.same_machine) else "DIFFERS"
        table.add_row(file.stage, file.name, *numbers, state)
    return table


def told(found: Verification, tell: Callable[[str], None]) -> None:
    """Name what differs, and say what all of it comes to.

    Args:
        found: the comparison.
        tell: takes a line.
    """
    lines = [line for file in found.files for line in _lines(found, file)]
    for line in lines[:_TOLD]:
        tell(line)
    if len(lines) > _TOLD:
        tell(f"{len(lines) - _TOLD} more differ")
    measure = (
        "to the last digit: the machine, its libraries and threads are those of the run"
        if found.same_machine
        else f"within {TOLERANCE:g} of the largest number of its array: the run was on another "
        "machine, or with other libraries or threads"
    )
    state = "agree" if found.agrees else "do NOT all agree"
    tell(f"{found.results}: {len(found.files)} files {state} ({measure})")


def _lines(found: Verification, file: VerifiedFile) -> Iterator[str]:
    path = found.results / file.name
    if file.fault:
        yield f"{path}: {file.fault}"
    for each in file.comparison.differences if file.comparison else ():
        if found.same_machine or not each.within or file.fault:
            yield (
                f"{path}: {each.name}: stored {each.stored}, computed {each.computed} "
                f"(difference {_size(each.size)})"
            )


def _size(size: float) -> str:
    """Return a difference of the largest number of its array."""
    if not size:
        return "0"
    return f"{size:.1e}" if size != float("inf") else "of a count or a text"

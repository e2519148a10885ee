"""Solvers outside this process: write the deck, run the program, read its result."""

from __future__ import annotations

import logging
import math
import os
import re
import shutil
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from solver_adapters.checks.capabilities import refuse_unsupported
from solver_adapters.checks.simulation import refuse_bad_simulation
from solver_adapters.interface import (
    Capabilities,
    PreparedError,
    Progress,
    Response,
    Simulation,
)
from solver_adapters.jobs.answer import refuse_bad_response, refuse_other_deck
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.failure import PASSING, Failure, failed, limit_told, missing
from solver_adapters.jobs.folder import (
    RESPONSE,
    RUNNING,
    Record,
    legible,
    log_of,
    note_use,
    put_away,
    read_record,
    refuse_other_files,
    settle,
    write_aside,
    write_ended,
    write_record,
)
from solver_adapters.jobs.identity import NoAnswerError, hash_of, told_by
from solver_adapters.jobs.key import hash_of_simulation, key_with_deck
from solver_adapters.jobs.lock import sole_process
from solver_adapters.jobs.prepared import (
    ELSEWHERE,
    FROM_ELSEWHERE,
    PREPARED,
    exit_code,
    has_results,
    prepare,
    prepared_job,
    refresh,
    refuse_other_job,
)
from solver_adapters.jobs.runner import CRASH_CODES, KILL_CODES, Ended, Limits, run_program
from solver_adapters.jobs.status import CACHED
from solver_adapters.jobs.status import Status as Status
from solver_adapters.profile import Profile as Profile
from solver_adapters.registry import installed_capabilities
from solver_adapters.response_file import (
    Provenance,
    read_provenance,
    read_response,
    write_response,
)
from solver_adapters.result_files import ResultFileError as ResultFileError

# Adapters of other packages take Status, Profile and ResultFileError from here.

ABSENT = "absent"
"""Identity of a program that is not on this machine."""

_LOG = logging.getLogger(__name__)
_LINES_OF_ANSWER = 10
_FULL = 2e6  # bytes that are free on a disk that is full
# What the loader of the system says of a program whose libraries are not there.
_NO_LIBRARY = re.compile(r"error while loading shared libraries|cannot open shared object file")
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class ExternalAdapter(ABC):
    """An adapter whose solver is a program of its own.

    A subclass says what it can honour, by its capabilities and, where they do not say all, by
    `check_supported`, and has three functions, each of which can be tested alone: `write` renders
    the files of a job, `read` understands the files that the program leaves, and `diagnose` its
    log. Where it can, it also tells the version (`version_call`, `version_in`), the lines of
    the log that say why a run failed (`cause`) and the instant that a run has reached (`reached`).

    Attributes:
        name: word of the case file.
        programs: commands that are looked for on PATH, the best first.
        results: files that the program leaves and no other does; one of them tells that a prepared
            job was computed where its script, which leaves its exit code, was not used.
        scratch: folders in that of the job which nobody needs once the program has ended.
        version_call: arguments with which the program tells its version; empty for a program that
            is known by its hash.
        profile: how the program is called.
    """

    name: str
    programs: tuple[str, ...]
    results: tuple[str, ...] = ()
    scratch: tuple[str, ...] = ()
    version_call: tuple[str, ...] = ()

    def __init__(self, profile: Profile | None = None) -> None:
        self.profile = profile or Profile()

    @abstractmethod
    def capabilities(self) -> Capabilities:
        """Return what this solver can honour."""

    def files(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Files of the job by name, of a simulation that can be honoured.

        Raises:
            UnsupportedError: a value cannot be honoured; it and who can are named.
            BadSimulationError: the input is broken, see `refuse_bad_simulation`.
        """
        refuse_bad_simulation(simulation)
        refuse_unsupported(simulation, self.name, self.capabilities(), installed_capabilities)
        self.check_supported(simulation)
        return self.write(simulation)

    def check_supported(self, simulation: Simulation) -> None:
        """Refuse values that the capabilities leave open; by default none.

        Raises:
            UnsupportedError: what the solver cannot do, in one sentence.
        """
        return  # the capabilities say all

    @abstractmethod
    def write(self, simulation: Simulation) -> Mapping[str, bytes]:
        """Render the files of the job by name: a pure function of simulation and profile.

        It gets what `files` has let pass, and refuses nothing.

        A deck may mark its provenance and its limits, see `jobs.key.what_is_computed`.
        """

    @abstractmethod
    def command(self, program: tuple[str, ...]) -> tuple[str, ...]:
        """Return the call, made in the folder of the job; `program` as found on this machine."""

    @abstractmethod
    def read(self, simulation: Simulation, folder: Path) -> Response:
        """Return the response from the files that the program has left in the folder of the job.

        Raises:
            ResultFileError: a file is missing, truncated, empty or not what it should be.
        """

    @abstractmethod
    def diagnose(self, log: str) -> Status:
        """Return what the log says: DONE where it says nothing of a failure."""

    def cause(self, log: str) -> str:
        """Return lines of a log that say why the run failed; "" where its last ones have to do."""
        return ""

    def reached(self, simulation: Simulation, folder: Path) -> float | None:
        """Return instant that the running job has reached [s], None where its files do not tell."""
        return None

    def version_in(self, answer: str) -> str | None:
        """Name and version in the answer to `version_call`, None where it holds none."""
        return None

    def version(self) -> str:
        """Identity of the program that is found, part of the job key; "absent" if there is none.

        It is the version that the program tells, or a hash of the executable and of the files that
        the profile calls it with, where the program is not asked.

        Raises:
            JobError: the program is there and cannot tell its version.
        """
        program = self.program()
        if program is None:
            return ABSENT
        if not self.version_call:
            return hash_of(program)
        call = (*program, *self.version_call)
        try:
            answer = told_by(call)
        except NoAnswerError as error:
            answer = str(error)
        found = self.version_in(answer)
        if found is None:
            said = legible(answer.splitlines()[-_LINES_OF_ANSWER:])
            raise JobError(
                self.name, Status.BROKEN, f"found no version in the answer to {' '.join(call)}",
                said,
            )  # fmt: skip
        return found

    def _identity(self) -> str:
        """Return version, which a program of this machine need not tell for jobs of another one."""
        try:
            return self.version()
        except JobError:
            if self.profile.prepare_only:
                return ABSENT
            raise

    def program(self) -> tuple[str, ...] | None:
        """Return the program on this machine with its leading arguments; None if it is absent."""
        if self.profile.command:
            name, *arguments = self.profile.command
            found = shutil.which(name)
            return None if found is None else (os.path.abspath(found), *arguments)
        found = next((path for name in self.programs if (path := shutil.which(name))), None)
        return None if found is None else (os.path.abspath(found),)

    def environment(self) -> dict[str, str]:
        """Variables that the program gets beside those of this process."""
        return dict.fromkeys(_THREAD_VARIABLES, str(self.profile.threads))

    def solve(
        self,
        simulation: Simulation,
        workspace: Path | None = None,
        progress: Callable[[Progress], None] | None = None,
    ) -> Response:
        """Run a simulation as a job, or take its response from an earlier one.

        Where another process runs the same job in the same folder its end is waited for.

        Args:
            simulation: what to solve.
            workspace: the folder of all jobs, each in a folder named by its key; None for one
                that is removed.
            progress: called from time to time with the instant that the program has reached, the
                first one where it does not tell, or with who is waited for. What it raises ends
                job and wait.

        Raises:
            UnsupportedError: a value cannot be honoured; it and who can are named.
            BadSimulationError: the input is broken, see `refuse_bad_simulation`.
            CommandMissingError: the program is absent.
            PreparedError: the job was written for another machine.
            JobError: the job brought no response; status, what its log says and remedy are in it.
        """
        files, identity = self.files(simulation), self._identity()
        here, elsewhere = (
            self._record(simulation, files, solver) for solver in (identity, ELSEWHERE)
        )
        with _jobs_in(workspace) as jobs:
            for job, statuses in ((here, CACHED), (elsewhere, FROM_ELSEWHERE)):
                known = self._known(simulation, jobs / job.key, files, statuses, progress)
                if known is not None:
                    return known
            waiting = prepared_job(jobs / elsewhere.key)
            if waiting is not None and has_results(jobs / elsewhere.key, self.results):
                with self._alone(simulation, jobs / elsewhere.key, progress):
                    # Another process may have collected it meanwhile.
                    known = self._mended(simulation, jobs / elsewhere.key, files, FROM_ELSEWHERE)
                    if known is not None:
                        return known
                    return self._collect(simulation, jobs / elsewhere.key, waiting, files)
            if self.profile.prepare_only:
                with self._alone(simulation, jobs / elsewhere.key, progress):
                    self._prepare(jobs, elsewhere, files, waiting)
                raise PreparedError([jobs / elsewhere.key])
            program = self.program()
            if program is None:
                raise missing(
                    self.name, self.programs, self.profile,
                    "" if waiting is None else str(jobs / elsewhere.key),
                )  # fmt: skip
            with self._alone(simulation, jobs / here.key, progress):
                # Another process may have run it meanwhile.
                known = self._mended(simulation, jobs / here.key, files, CACHED)
                if known is not None:
                    return known
                record = replace(here, command=self.command(program))
                return self._run(simulation, jobs, record, files, progress)

    def _record(self, simulation: Simulation, files: Mapping[str, bytes], identity: str) -> Record:
        """Return the record of a job that has not begun."""
        simulated = hash_of_simulation(simulation, self.name, identity)
        return Record(
            self.name, key_with_deck(simulated, files), identity, status="", files=sorted(files),
            simulation=simulated, asker=self.profile.asker,
        )  # fmt: skip

    @contextmanager
    def _alone(
        self,
        simulation: Simulation,
        folder: Path,
        progress: Callable[[Progress], None] | None,
    ) -> Iterator[None]:
        """Keep all others from a job; wait where one has it."""

        def waiting(holder: str) -> None:
            if progress is not None:
                progress(replace(_progress(simulation, -math.inf, 0.0), holder=holder))

        with sole_process(folder, waiting):
            yield

    def _known(
        self,
        simulation: Simulation,
        folder: Path,
        files: Mapping[str, bytes],
        statuses: Collection[str],
        progress: Callable[[Progress], None] | None,
    ) -> Response | None:
        """Return the response of a finished job; None where there is none, or one beyond repair."""
        record = read_record(folder, statuses)
        if record is None or record.status == PREPARED:
            return None
        try:
            return self._whole(simulation, folder, record)
        except ResultFileError:
            with self._alone(simulation, folder, progress):
                return self._mended(simulation, folder, files, statuses)

    def _whole(self, simulation: Simulation, folder: Path, record: Record) -> Response:
        """Return the response of a finished job as it is stored, and raise its error.

        Raises:
            ResultFileError: the stored response is damaged, or of another job.
            JobError: the job brought none.
        """
        if record.status != Status.DONE:
            note_use(folder)
            raise self._failed(Failure(Status(record.status), record.detail), folder)
        response = _stored(simulation, folder, record)
        note_use(folder)
        return response

    def _mended(
        self,
        simulation: Simulation,
        folder: Path,
        files: Mapping[str, bytes],
        statuses: Collection[str],
    ) -> Response | None:
        """Return as `_known`, for a process that has the job alone.

        Where the stored response is damaged, or of another job, the result files are read again.
        Where these are no better, the folder gets another name: nobody's results are removed.
        """
        record = read_record(folder, statuses)
        if record is None or record.status == PREPARED:
            return None
        try:
            return self._whole(simulation, folder, record)
        except ResultFileError as error:
            damage = str(error)
        try:
            refuse_other_files(folder, record, record.digests.keys() - {RESPONSE})
            found = self._read_again(simulation, folder, record, files)
        except ResultFileError as error:
            found = Failure(Status.NO_RESULT, str(error))
        if not isinstance(found, Failure):
            _LOG.warning("%s; its result files were read again", damage)
            return found
        _LOG.warning(
            "%s; nor can its result files be read (%s); the folder is kept as %s, and the job is "
            "made anew", damage, found.detail or found.status, put_away(folder),
        )  # fmt: skip
        return None

    def _run(
        self,
        simulation: Simulation,
        jobs: Path,
        record: Record,
        files: Mapping[str, bytes],
        progress: Callable[[Progress], None] | None,
    ) -> Response:
        folder = write_aside(jobs, record.key, files)
        write_record(folder, replace(record, status=RUNNING))
        limits = Limits(self.profile.memory, self.profile.wall_time, self.profile.cpu_time)
        begun, furthest = time.monotonic(), -math.inf

        def waiting() -> None:
            nonlocal furthest
            if progress is not None:
                reached = self.reached(simulation, folder)
                furthest = furthest if reached is None else max(furthest, reached)
                progress(_progress(simulation, furthest, time.monotonic() - begun))

        try:
            ended = run_program(record.command, folder, limits, self.environment(), waiting)
            for name in self.scratch:
                shutil.rmtree(folder / name, ignore_errors=True)
        except BaseException:
            # Stopped on its way: what there is is of no use.
            shutil.rmtree(folder, ignore_errors=True)
            raise
        record = replace(
            record, code=ended.code, wall=ended.wall, cpu=ended.cpu, memory=ended.memory
        )
        try:
            found = self._outcome(simulation, folder, ended)
            if isinstance(found, Failure) and shutil.disk_usage(folder).free < _FULL:
                # On a full disk the log that would tell it is not whole.
                found = Failure(Status.OUT_OF_DISK, found.detail)
            if not isinstance(found, Failure):
                write_response(folder / RESPONSE, found, _provenance(record))
        except BaseException:
            # A full disk, or Ctrl-C: what was computed is not removed with the dead.
            settle(folder, jobs, record.key, Status.NO_RESULT)
            raise
        if isinstance(found, Failure):
            write_ended(folder, replace(record, status=found.status, detail=found.detail))
            raise self._failed(found, settle(folder, jobs, record.key, found.status))
        write_ended(folder, replace(record, status=Status.DONE))
        settle(folder, jobs, record.key, Status.DONE)
        return found

    def _failed(self, failure: Failure, folder: Path, remedy: str = "") -> JobError:
        return failed(self.name, failure, folder, self.cause(log_of(folder)), remedy)

    def _prepare(
        self, jobs: Path, record: Record, files: Mapping[str, bytes], waiting: Record | None
    ) -> None:
        """Write a job for another machine, or give the one that waits what is stated now."""
        program = self.profile.command or (self.programs[0],)
        record = replace(record, status=PREPARED, command=self.command(program))
        if waiting is None:
            prepare(jobs, record, files, self.environment(), self.scratch)
        else:
            folder = jobs / record.key
            refresh(folder, waiting, record, files, self.environment(), self.scratch)

    def _collect(
        self, simulation: Simulation, folder: Path, record: Record, files: Mapping[str, bytes]
    ) -> Response:
        """Return the response of a job that was computed elsewhere; its files stay as they are."""
        try:
            found = self._read_again(simulation, folder, record, files)
        except ResultFileError as error:
            found = Failure(Status.NO_RESULT, str(error))
        if isinstance(found, Failure):
            lost = f"copy all files back, or delete {folder.name} to have it prepared anew"
            remedy = lost if found.status is Status.NO_RESULT else ""
            raise self._failed(found, folder, remedy)
        return found

    def _read_again(
        self, simulation: Simulation, folder: Path, record: Record, files: Mapping[str, bytes]
    ) -> Response | Failure:
        """Return the response from the result files in a folder, stored there once more.

        Raises:
            ResultFileError: the files are of another job, or their exit code is not known.
        """
        refuse_other_job(folder)
        refuse_other_deck(folder, files)
        code = exit_code(folder)
        found = self._outcome(simulation, folder, Ended(None, code, None, 0.0, 0.0, 0.0))
        if not isinstance(found, Failure):
            write_response(folder / RESPONSE, found, _provenance(record))
            write_ended(folder, replace(record, status=Status.DONE, code=code))
        return found

    def _outcome(self, simulation: Simulation, folder: Path, ended: Ended) -> Response | Failure:
        """Return what a program that has ended leaves: first the system's word, then its log's."""
        if ended.status is not None:
            return Failure(ended.status, limit_told(ended, self.profile))
        code, log = f"exit code {ended.code}" if ended.code else "", log_of(folder)
        said = self.diagnose(log)
        if said is not Status.DONE:
            return Failure(said, code)
        if ended.code:
            return Failure(_fault(ended.code, log), code)
        try:
            response = self.read(simulation, folder)
            refuse_bad_response(simulation, response)
        except ResultFileError as error:
            return Failure(Status.NO_RESULT, str(error))
        return response


def _progress(simulation: Simulation, reached: float, spent: float) -> Progress:
    """How far a running job is, after a wall-clock time [s]."""
    begin, end = float(simulation.times[0]), float(simulation.times[-1])
    now = max(begin, reached)
    left = spent * (end - now) / (now - begin) if now > begin else math.nan
    return Progress(now, end, steps=0, iterations=0, cuts=0, remaining=left)


def _fault(code: int, log: str) -> Status:
    """Return what a program failed by whose log tells nothing that its adapter knows."""
    if _NO_LIBRARY.search(log):
        return Status.BROKEN
    if code in KILL_CODES:
        return Status.KILLED
    return Status.CRASHED if code in CRASH_CODES else Status.NO_RESULT


def _provenance(record: Record) -> Provenance:
    return Provenance(record.adapter, record.solver, record.key)


def _stored(simulation: Simulation, folder: Path, record: Record) -> Response:
    """Return the response that was stored in the folder of a job, if it is that of this job."""
    path, hashed = folder / RESPONSE, RESPONSE in record.digests
    refuse_other_files(folder, record, [RESPONSE])
    key = read_provenance(path, hashed).key
    if key != folder.name:
        raise ResultFileError(f"{path}: found the response of the job {key}, expected this job's")
    response = read_response(path, hashed)
    refuse_bad_response(simulation, response)
    return response


@contextmanager
def _jobs_in(workspace: Path | None) -> Iterator[Path]:
    if workspace is not None:
        yield workspace
    else:
        with tempfile.TemporaryDirectory(prefix=PASSING) as folder:
            yield Path(folder)

"""Faults in the middle of each phase: the next call gives the same numbers, and nothing is left.

Those of one phase come one after the other: each meets what the one before has left, and the last
calls go on to the end.
"""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import psutil
import pytest

from driver.case.model import load_case, write_case
from driver.verify.numbers import FORMATS, numbers_of
from tests.driver.cache.test_two_drivers import case as case_of_loads
from tests.reliability.gate import EVERY
from tests.reliability.laboratory import Call, Laboratory
from tools import closed_form
from tools.fault_table import PHASES, pairs

pytestmark = pytest.mark.slow
YEAR = 365 * 86400.0  # s
ORPHANS = 5.0  # s after which nothing of a call that has ended may live
STOPPED = "prismid: stopped; finished stages are kept, run again to go on\n"
LOADS = ("0,0,,0", "60,20,,0.3", "120,40,,0.52", "180,60,,0.6", "240,45,,0.4")
SETTINGS = "[microscope]\nrepeats = 2\n[program]\ncycles = [[2, 1]]\nlargest_strain = 0.01\n"
# Where a phase waits: event of Python's audit, and pattern of what it is about.
GATES = {
    "mesh": r"os.rename|results/mesh\.med$",
    "measure": r"open|measure\.partial/",
    "identify": "laboratory.solve|.",
    "diagnose": "laboratory.solve|.",
    "report": r"open|report\.partial/",
    "export": r"os.rename|/out/[^/]*\.vt",
    "virtual": r"os.rename|/out/history\.csv$",
    "batch": r"os.rename|results/mesh\.med$",
}
# In a process that works for the one that was called, where a phase has such.
IN_A_WORKER = {"identify": "laboratory.solve|worker", "diagnose": "laboratory.solve|worker"}
# Results of a phase of which one is truncated, and a byte of the other flipped.
RESULTS = {
    "mesh": ("mesh.med", "mesh_fine.med"), "measure": ("measure.h5", "measure.csv"),
    "identify": ("identify.h5", "identify.csv"), "diagnose": ("diagnosis.json", "diagnosis.h5"),
    "report": ("report.html",), "batch": ("mesh.med", "mesh_fine.med"),
}  # fmt: skip
PROGRAM = "nothing|"  # the program of a solver has a gate of its own
AFTER = 5  # jobs
_OF_A_RUN = ("run.lock", "stages.json", "logs", "summary.csv", "summary.html")


def mounts() -> bool:
    """Whether this user may mount."""
    child = os.fork()
    if child == 0:
        os._exit(int(ctypes.CDLL(None).unshare(0x00020000) != 0))
    return os.waitpid(child, 0)[1] == 0


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Laboratory]:
    made = Laboratory(tmp_path_factory.mktemp("laboratory"))
    yield made
    made.close()


def files_of(folder: Path) -> dict[str, Path]:
    """Results in a folder by name, without what tells of the run and of edits."""
    found = {}
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        kept = not set(parts) & set(_OF_A_RUN) and ".edited" not in path.name
        if path.is_file() and kept:
            found["/".join(parts)] = path
    return found


def refuse_other_numbers(name: str, found: Path, expected: Path) -> None:
    if found.suffix not in FORMATS:
        assert found.stat().st_size, name
        return
    numbers, others = numbers_of(found), numbers_of(expected)
    assert numbers.keys() == others.keys(), name
    for key, values in numbers.items():
        np.testing.assert_array_equal(values, others[key], err_msg=f"{name}, {key}")


@dataclass
class Place:
    """Where a phase is at work.

    Attributes:
        folder: all that it reads and writes.
        results: what it makes, below the folder.
        reference: the same of a run that nothing has disturbed.
        call: of prismid.
        started: the stages that it has to compute.
    """

    folder: Path
    results: Path
    reference: Path
    call: tuple[str, ...]
    started: tuple[str, ...]


@dataclass
class Faults:
    """The faults of a phase, and what each has come to.

    Attributes:
        outcomes: what was wrong, "" for nothing, by fault.
    """

    laboratory: Laboratory
    phase: str
    place: Place
    outcomes: dict[str, str] = field(default_factory=dict)

    def step(self, faults: Sequence[str], act: Callable[[], None]) -> None:
        told = ""
        try:
            act()
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
        finally:
            self.laboratory.open()
        for fault in faults:
            self.outcomes[fault] = self.outcomes.get(fault, "") or told

    def at_the_gate(self, workers: bool = False) -> Call:
        more: tuple[str, ...] = ()
        gate = GATES[self.phase]
        if workers and self.phase in IN_A_WORKER:
            more, gate = ("--processes", "2"), IN_A_WORKER[self.phase]
        call = self.laboratory.start(*self.place.call, *more, gate=gate)
        call.reached()
        return call

    def refuse_what_is_left(self, call: Call) -> None:
        """Nothing of it lives, and what is in its place is whole."""
        assert call.living(ORPHANS) == [], "alive"
        assert "Traceback" not in call.text() and "a fault of prismid" not in call.text()
        self.refuse_half_files()

    def refuse_half_files(self) -> None:
        whole = files_of(self.place.reference)
        for name, path in files_of(self.place.results).items():
            # Folders of what was at work, the simulations that an interrupted stage keeps until it
            # ends, and the empty file that tells cases to go on, are none.
            if not re.search(r"\.partial/|^partial-|\.kept/|\.batch/running-", name):
                assert name in whole, f"found {name}"
                refuse_other_numbers(name, path, whole[name])

    def refuse_another_end(self, code: int, said: str) -> None:
        """The call has computed what was left and no more, and has the numbers of the reference."""
        assert code == 0, said
        started = tuple(re.findall(r"(\w+): started", said))
        assert started == self.place.started, f"started {started}"
        assert files_of(self.place.results).keys() == files_of(self.place.reference).keys()
        self.refuse_half_files()

    def killed(self) -> None:
        call = self.at_the_gate(workers=True)
        call.process.send_signal(signal.SIGKILL)
        assert call.end() == -signal.SIGKILL
        self.refuse_what_is_left(call)

    def worker_killed(self) -> None:
        call = self.at_the_gate(workers=True)
        os.kill(call.reached()[0], signal.SIGKILL)
        self.laboratory.open()
        code, said = call.end(), call.text()
        assert code == 1, said
        told = "SIGKILL" if self.phase == "batch" else "execution.processes: one of 2 processes"
        assert told in said
        self.refuse_what_is_left(call)

    def stopped(self, how: signal.Signals) -> None:
        call = self.at_the_gate(workers=how == signal.SIGTERM)
        call.process.send_signal(how)
        assert (call.end(), call.text().endswith(STOPPED)) == (130, True), call.text()
        self.refuse_what_is_left(call)

    def interrupted_twice(self) -> None:
        call = self.at_the_gate()
        (first, *_) = call.reached()
        os.killpg(call.process.pid, signal.SIGINT)
        # What is at the gate has heard of it, or of the end of what it works for.
        while not self.laboratory.marks("interrupted") and psutil.pid_exists(first):
            time.sleep(EVERY)
        with suppress(ProcessLookupError):
            os.killpg(call.process.pid, signal.SIGINT)
        assert (call.end(), call.text().endswith(STOPPED)) == (130, True), call.text()
        self.refuse_what_is_left(call)

    def cannot_write(self) -> None:
        before = files_of(self.place.folder).keys()
        call = self.laboratory.start(*self.place.call, read_only=[self.place.folder])
        assert call.end() == 1, call.text()
        assert "Read-only file system" in call.text()
        assert files_of(self.place.folder).keys() == before
        self.refuse_what_is_left(call)

    def on_a_full_disk(self) -> None:
        call = self.laboratory.start(*self.place.call, full=self.place.folder)
        assert call.end() == 1, call.text()
        assert "[Errno" not in call.text()
        self.refuse_what_is_left(call)

    def to_the_end_without_temporary_files(self) -> None:
        nowhere = self.laboratory.folder / "home"
        there = [path for path in ("/tmp", "/var/tmp") if Path(path).is_dir()]
        code, said = self.laboratory.run(
            *self.place.call, read_only=[*map(Path, there), nowhere],
            writable=[self.place.folder, self.laboratory.folder],
            variables={"TMPDIR": str(nowhere), "HOME": str(nowhere)},
        )  # fmt: skip
        self.refuse_another_end(code, said)

    def damaged(self) -> None:
        first, *others = RESULTS[self.phase]
        path = next(self.place.results.rglob(first))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        for name in others:
            other = path.with_name(name)
            content = bytearray(other.read_bytes())
            content[len(content) // 2] ^= 0x10
            other.write_bytes(content)

    def disturbed(self) -> None:
        """A second call, the clock and an edit, all at the gate; then it goes on to the end."""
        case = next(self.place.folder.rglob("case.toml"))
        text = case.read_text("utf-8")
        call = self.at_the_gate()
        self.step(["two runs"], self._refuse_second)
        (self.laboratory.folder / "closed").touch()
        for path in self.place.folder.rglob("*"):
            later = path.stat().st_mtime + YEAR
            os.utime(path, (later, later))
        case.write_text(re.sub(r"(\nlength_um = )\S+", r"\g<1>4.2", text), "utf-8")
        self.laboratory.open()
        code, said = call.end(), call.text()
        if self.place.call[0] == "run":
            _, told = self.laboratory.run("status", str(case))
            assert re.search(rf"^ +{self.phase} +(?!done)\w", told, re.MULTILINE), told
        case.write_text(text, "utf-8")
        self.refuse_another_end(code, said)
        if self.place.call[0] == "run":
            code, said = self.laboratory.run(*self.place.call)
            assert code == 0 and not re.findall(r"(\w+): started", said), said

    def _refuse_second(self) -> None:
        closed = self.laboratory.folder / "closed"
        code, said = self.laboratory.run(*self.place.call)
        assert closed.exists()
        assert code == 0 if self.phase == "export" else (code == 1 and "another" in said), said

    def to_its_end(self) -> None:
        """Try all faults of the phase, one after the other."""
        self.step(["kill"], self.killed)
        if "kill worker" in self.faults:
            self.step(["kill worker"], self.worker_killed)
        for how in (signal.SIGTERM, signal.SIGHUP):
            self.step([how.name], partial(self.stopped, how))
        self.step(["Ctrl-C twice"], self.interrupted_twice)
        if mounts():
            self.step(["read-only"], self.cannot_write)
            self.step(["full disk"], self.on_a_full_disk)
            self.step(["no TMPDIR or HOME"], self.to_the_end_without_temporary_files)
        else:
            finished(self.laboratory, *self.place.call)
        if "damage" in self.faults:
            self.step(["damage"], self.damaged)
        else:  # the verb makes all of it, once more
            shutil.rmtree(self.place.results)
        self.step(["damage", "clock", "edited"], self.disturbed)

    @property
    def faults(self) -> set[str]:
        return {fault for fault, phase in pairs() if phase == self.phase}


def prepared(folder: Path) -> None:
    """A case of which nothing is wrong, with few causes."""
    folder.mkdir()
    closed_form.write_files(folder, {"tau0": 44.0})
    changes = {
        "solver.name": "closed_form", "identification.starts": 2,
        "identification.max_iterations": 3, "diagnosis.refit": 1,
        "diagnosis.causes": ("load_gain",),
    }  # fmt: skip
    write_case(load_case(folder / "case.toml").with_values_at(changes), folder / "case.toml")


def prepared_loads(folder: Path, solver: str) -> None:
    """A case of loads alone."""
    folder.mkdir()
    (folder / "history.csv").write_text("\n".join(("time_s,stage_um,image,force_N", *LOADS)))
    case = case_of_loads().with_values_at({"solver.name": solver, "execution.store": None})
    write_case(case, folder / "case.toml")


def finished(laboratory: Laboratory, *call: str) -> None:
    code, said = laboratory.run(*call)
    assert code == 0, said


@pytest.fixture(scope="module")
def states(laboratory: Laboratory, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Folders of a case before each stage by its name, and after all."""
    made, base = {}, tmp_path_factory.mktemp("states")
    prepared(base / "mesh")
    for stage, after in zip(PHASES[:4], (*PHASES[1:4], "end"), strict=True):
        made[stage], made[after] = base / stage, base / after
        shutil.copytree(base / stage, base / after)
        finished(laboratory, "run", str(base / after), "--until", stage)
    prepared_loads(base / "loads", "closed_form")
    made["report"], made["reported"] = base / "loads", base / "reported"
    finished(laboratory, "run", str(base / "loads"), "--until", "identify")
    shutil.copytree(base / "loads", base / "reported")
    finished(laboratory, "run", str(base / "reported"))
    return made


def place_of(phase: str, laboratory: Laboratory, states: dict[str, Path], folder: Path) -> Place:
    """Where a phase is at work, and what it makes there undisturbed."""
    at, other, results = folder / "at work", folder / "reference", "results"
    if phase in PHASES[:5]:
        shutil.copytree(states[phase], at)
        after = {**dict(zip(PHASES, PHASES[1:4], strict=False)), "diagnose": "end"}
        reference = states["reported" if phase == "report" else after[phase]]
        call = ("run", str(at), "--until", phase)
        return Place(at, at / results, reference / results, call, (phase,))
    if phase == "export":
        shutil.copytree(states["end"], at)
        words: tuple[str, ...] = ("export", str(at), "--no-volume", "--to")
        finished(laboratory, *words, str(other))
        return Place(at, at / "out", other, (*words, str(at / "out")), ())
    if phase == "virtual":
        at.mkdir()
        write_case(
            closed_form.small_case().with_values_at({"solver.name": "closed_form"}),
            at / "case.toml",
        )
        (at / "settings.toml").write_text(SETTINGS)
        words = ("virtual", str(at), "--settings", str(at / "settings.toml"), "--to")
        finished(laboratory, *words, str(other))
        return Place(at, at / "out", other, (*words, str(at / "out")), ())
    for folder in (at, other):
        folder.mkdir()
        for name in "ab":
            shutil.copytree(states["mesh"], folder / name)
        (folder / "campaign.toml").write_text('cases = ["a", "b"]\nuntil = "mesh"\n')
    finished(laboratory, "batch", str(other / "campaign.toml"))
    return Place(at, at, other, ("batch", str(at / "campaign.toml")), ())


Outcome = Callable[[str], dict[str, str]]


@pytest.fixture(scope="module")
def outcomes(
    laboratory: Laboratory, states: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Outcome:
    """What the faults of a phase have come to, found when it is asked for first."""
    known: dict[str, dict[str, str]] = {}

    def of(phase: str) -> dict[str, str]:
        if phase not in known:
            folder = tmp_path_factory.mktemp(phase)
            made = Faults(laboratory, phase, place_of(phase, laboratory, states, folder))
            known[phase] = made.outcomes
            made.to_its_end()
        return known[phase]

    return of


ONE_AFTER_THE_OTHER = sorted(
    (pair for pair in pairs() if pair[0] != "kill solver"), key=lambda pair: PHASES.index(pair[1])
)


@pytest.mark.parametrize(("fault", "phase"), ONE_AFTER_THE_OTHER)
def test_after_a_fault_the_next_call_gives_the_same_numbers(
    fault: str, phase: str, outcomes: Outcome
) -> None:
    found = outcomes(phase)
    if fault not in found:
        pytest.skip("this user may not mount")
    assert found[fault] == ""


@pytest.mark.parametrize(("fault", "phase"), [("kill solver", "identify")])
def test_after_the_end_of_a_program_only_its_job_is_run_again(
    fault: str, phase: str, laboratory: Laboratory, tmp_path: Path
) -> None:
    runs = laboratory.folder / "runs"
    prepared_loads(tmp_path / "undisturbed", "closed_form_program")
    finished(laboratory, "run", str(tmp_path / "undisturbed"), "--until", phase)
    jobs = len(runs.read_text().splitlines())
    assert jobs > AFTER
    runs.unlink()
    prepared_loads(tmp_path / "killed", "closed_form_program")
    words = ("run", str(tmp_path / "killed"), "--until", phase)
    call = laboratory.start(*words, gate=PROGRAM)
    (program,) = call.reached()
    os.kill(program, signal.SIGKILL)
    code, said = call.end(), call.text()
    laboratory.open()
    assert code == 1 and "ended from outside" in said, said
    assert call.living(ORPHANS) == []
    assert len(runs.read_text().splitlines()) == AFTER
    finished(laboratory, "run", str(tmp_path / "killed"), "--until", phase)
    assert len(runs.read_text().splitlines()) == jobs
    one, other = (files_of(tmp_path / name / "results") for name in ("undisturbed", "killed"))
    for name in ("identify.h5", "identify.csv"):
        refuse_other_numbers(name, other[name], one[name])

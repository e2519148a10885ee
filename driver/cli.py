"""The command line: `prismid` with a verb, from `init` to `noise-floor`."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, sleep, time
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.markup import escape

from driver.case.model import (
    CASE_FILE,
    SCHEMA_FILE,
    CaseError,
    default_case,
    schema_text,
    write_case,
)
from driver.common.atomic_write import write_whole
from driver.common.errors import InputError, sentence, why
from driver.common.formatting import byte_size, duration
from driver.common.progress import progress_to, seldom
from driver.results.files import EXPORT, RESULTS
from meshes.system_libraries import SystemLibraryError
from solver_adapters.interface import PreparedError, SolverError

if TYPE_CHECKING:
    from rich.table import Table

    from driver.batch.progress import State

_WIDEST = 1000  # columns
_AGAIN = 10.0  # s after which a process that was asked to end is asked once more
_MARKS = {"ok": "ok     ", "warning": "WARNING", "error": "ERROR  "}

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


cache = typer.Typer(no_args_is_help=True)
app.add_typer(cache, name="cache", help="Look after the store of a solver's jobs.")


def _path(text: str) -> Path:
    """Return a path that is not empty: an empty one would be the folder of the call."""
    if not text:
        raise typer.BadParameter('found "", expected the name of a file or a folder')
    return Path(text)


CaseArgument = Annotated[
    Path, typer.Argument(metavar="CASE", parser=_path, help="case.toml or its folder")
]


StoreArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FOLDER", parser=_path, help="folder of the jobs, case.toml or its folder"
    ),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"prismid {version('prismid')}")
        raise typer.Exit


@app.callback()
def main(
    show_version: Annotated[
        bool,
        typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version."),
    ] = False,
    end_with_input: Annotated[
        bool, typer.Option("--end-with-input", hidden=True, help="Stop where the input ends.")
    ] = False,
) -> None:
    """Identify crystal plasticity from a micro-prism in tension, and name what the model lacks."""
    # A batch system at its time limit, or a terminal that is closed, stops a run as Ctrl-C does.
    for end in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(end) == signal.SIG_DFL:  # nohup ignores the latter
            signal.signal(end, signal.default_int_handler)
    if end_with_input:
        # Who started it holds the other end, and has ended.
        threading.Thread(target=_stop_at_end_of_input, daemon=True).start()


def _stop_at_end_of_input() -> None:
    # Not by `sys.stdin`, whose lock would be held where Python ends.
    while os.read(sys.stdin.fileno(), 1):
        pass
    # Where Python cannot raise what the signal asks for, it tells so and goes on.
    while True:
        os.kill(os.getpid(), signal.SIGTERM)
        sleep(_AGAIN)


@app.command()
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", parser=_path, help="folder of the new case")
    ],
) -> None:
    """Write a commented case.toml, and its schema for editors, into DIR."""
    with _told_in_one_line():
        path, schema = folder / CASE_FILE, folder / SCHEMA_FILE
        if folder.exists() and not folder.is_dir():
            raise CaseError(sentence(folder, "DIR", "a file", "a folder, or nothing yet"))
        for file in (path, schema):
            if file.exists() or file.is_symlink():
                raise CaseError(sentence(file, "file", "a file", "none: it is not overwritten"))
        folder.mkdir(parents=True, exist_ok=True)
        write_case(default_case(), path)
        write_whole(schema, schema_text())
        typer.echo(f"{path} written: fill it in, then `prismid check {path}`")


@app.command()
def check(case: CaseArgument) -> None:
    """Validate CASE, its files, solver and libraries; estimate the cost; draw the set-up."""
    from driver.check.command import check as find

    with _told_in_one_line():
        findings = find(_case_file(case))
        for finding in findings:
            typer.echo(f"{_MARKS[finding.level]} {finding.subject}: {finding.message}")
    if any(finding.level == "error" for finding in findings):
        raise typer.Exit(1)


@app.command()
def run(
    cases: Annotated[
        list[Path], typer.Argument(metavar="CASE...", parser=_path, help="cases or folders")
    ],
    until: Annotated[
        str | None,
        typer.Option(help="last stage to run: mesh, measure, identify, diagnose, advise or report"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="run finished stages again")] = False,
    prepare_only: Annotated[
        bool,
        typer.Option("--prepare-only", help="write the solver's jobs for another machine"),
    ] = False,
    processes: Annotated[
        int | None, typer.Option(min=1, help="simulations side by side, default as in the case")
    ] = None,
    threads: Annotated[
        int | None, typer.Option(min=1, help="threads of each process, default as in the case")
    ] = None,
    store: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", parser=_path, help="of the solver's jobs, default as in the case"
        ),
    ] = None,
) -> None:
    """Run the stages of one CASE or many; what is done and unchanged is not done again."""
    from driver.workflow import pipeline

    failed = False
    for case in cases:
        # A bad case does not keep the next one from running.
        try:
            prefix = f"{case}: " if len(cases) > 1 else ""
            with _told_in_one_line(prefix), _progress(prefix):
                pipeline.run(
                    _case_file(case), until, force, prepare_only, processes, threads, store
                )
        except PreparedError as prepared:
            typer.echo(f"{case}: {prepared}")
        except typer.Exit:
            failed = True
        except KeyboardInterrupt:
            typer.echo("prismid: stopped; finished stages are kept, run again to go on", err=True)
            raise typer.Exit(130) from None
    if failed:
        raise typer.Exit(1)


@app.command()
def batch(
    campaign: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN", parser=_path, help="file of the campaign")
    ],
) -> None:
    """Run the cases of CAMPAIGN beside one another; compare what they came to."""
    from driver.batch.command import batch as run_all

    try:
        with _told_in_one_line(), _states() as watch:
            done = run_all(campaign, watch)
    except KeyboardInterrupt:
        typer.echo("prismid: stopped; finished stages are kept, run again to go on", err=True)
        raise typer.Exit(130) from None
    if not done:
        raise typer.Exit(1)


@app.command()
def trust(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE", parser=_path, help="case.toml, its folder, or file of a campaign"
        ),
    ],
    yes: Annotated[bool, typer.Option("--yes", help="do not ask")] = False,
) -> None:
    """Show what FILE would run or write outside its folder, and agree to it, once on this machine.

    Read docs/trust.md before you agree to what comes from others.
    """
    from driver.trust.command import agreed, asked_for, shown

    with _told_in_one_line():
        path = _case_file(file)
        requests = asked_for(path)
        if not requests:
            typer.echo(f"{path}: nothing to agree to")
            return
        for request in requests:
            typer.echo(shown(request))
        if not yes:
            typer.confirm("Agree?", abort=True)
        typer.echo(agreed(path, requests))


@app.command()
def report(case: CaseArgument) -> None:
    """Write the report page of CASE anew from its results."""
    from driver.workflow import pipeline

    with _told_in_one_line(), progress_to(typer.echo):
        pipeline.report(_case_file(case))


@app.command()
def export(
    case: CaseArgument,
    to: Annotated[
        Path | None,
        typer.Option(metavar="DIR", parser=_path, help="folder, default results/export"),
    ] = None,
    volume: Annotated[
        bool,
        typer.Option("--volume/--no-volume", help="stress and slips inside (simulates once more)"),
    ] = True,
    med: Annotated[bool, typer.Option("--med", help="the volume for Salome, too")] = False,
) -> None:
    """Write the results of CASE in the formats of other programs."""
    from driver.export.command import export_case

    path = _case_file(case)
    folder = to if to is not None else path.parent / RESULTS / EXPORT
    with _told_in_one_line(), _progress():
        export_case(path, folder, volume, med)


@app.command()
def verify(
    results: Annotated[
        Path,
        typer.Argument(
            metavar="RESULTS", parser=_path, help="folder of results, case.toml or its folder"
        ),
    ],
    until: Annotated[
        str | None, typer.Option(help="last stage to compute, default all that have results")
    ] = None,
) -> None:
    """Compute RESULTS anew, elsewhere, and compare every number; exit code 1 if any differs."""
    from driver.verify.command import table_of, told
    from driver.verify.command import verify as compare

    with _told_in_one_line():
        with _progress():
            found = compare(results, until)
        _show_table(table_of(found))
        told(found, typer.echo)
    if not found.agrees:
        raise typer.Exit(1)


@app.command("noise-floor")
def noise_floor(case: CaseArgument) -> None:
    """Measure what the correlation of CASE can see: errors against mesh size, the mesh to take."""
    from driver.noise_floor.command import noise_floor as measure

    with _told_in_one_line(), _progress():
        measure(_case_file(case))


@app.command()
def virtual(
    case: CaseArgument,
    to: Annotated[
        Path, typer.Option("--to", metavar="DIR", parser=_path, help="folder of the new case")
    ],
    settings: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", parser=_path, help="settings of face, microscope, test and truth"
        ),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="of relief, stage and noise")] = 0,
) -> None:
    """Make a virtual experiment of CASE: height maps, loads and history of a known truth.

    The truth is simulated on a finer mesh and with smaller steps than any that the case
    identifies with.
    """
    from driver.virtual.command import virtual as make

    with _told_in_one_line(), _progress():
        make(_case_file(case), settings, to, seed)


@app.command()
def design(
    case: CaseArgument,
    settings: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=_path, help="what is assumed of face, test and truth"),
    ] = None,
    change: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUE", help='a change to compare, as "loads.noise_uN=2"'),
    ] = None,
    usual: Annotated[
        bool, typer.Option("--usual/--no-usual", help="compare the usual changes, too")
    ] = True,
) -> None:
    """Say before an experiment what CASE will know of parameters and causes, and what limits it."""
    from driver.design.command import design as foresee

    with _told_in_one_line(), _progress():
        foresee(_case_file(case), settings, change or (), usual)


@cache.command("list")
def cache_list(where: StoreArgument = Path()) -> None:
    """Show the jobs of a store: solver, state, size, last use, and the case that asked for it."""
    from driver.cache.command import jobs_at, table_of, total_of

    with _told_in_one_line():
        store, jobs = jobs_at(where)
        if jobs:
            _show_table(table_of(jobs, time()))
        typer.echo(total_of(store, jobs))


@cache.command("verify")
def cache_verify(where: StoreArgument = Path()) -> None:
    """Compare the jobs of a store with their keys and checksums, and name what does not match."""
    from driver.cache.command import jobs_at, verified, verify

    with _told_in_one_line():
        store, jobs = jobs_at(where)
        whole, faulty = verify(jobs, typer.echo)
        typer.echo(verified(store, whole, faulty))
    if faulty:
        raise typer.Exit(1)


@cache.command("prune")
def cache_prune(
    where: StoreArgument = Path(),
    failed: Annotated[
        bool, typer.Option("--failed", help="only what is failed, unfinished or damaged")
    ] = False,
    older_than: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="DAYS", help="only what was not used for so many days"),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="do not ask")] = False,
) -> None:
    """Remove jobs of a store; none that somebody works on."""
    from driver.cache.command import jobs_at, prune, pruned, table_of, to_prune

    with _told_in_one_line():
        store, jobs = jobs_at(where)
        chosen = to_prune(jobs, failed, older_than, time())
        if not chosen:
            typer.echo(f"{store}: nothing to remove")
            return
        _show_table(table_of(chosen, time()))
        if not yes:
            typer.confirm(f"Remove {pruned(chosen)}?", abort=True)
        freed = prune(chosen, typer.echo)
        typer.echo(f"{store}: {byte_size(freed)} freed")


def _show_table(table: Table) -> None:
    """Show a table, as wide as it is where nobody looks at it on a terminal."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=_WIDEST)
    console.print(table)


def _case_file(case: Path) -> Path:
    """Return the case file, where the folder of the case was given."""
    return case / CASE_FILE if case.is_dir() else case


@contextmanager
def _told_in_one_line(prefix: str = "") -> Iterator[None]:
    """Turn what a user can mend into a line on standard error and the exit code 1.

    Args:
        prefix: what a line begins with after the name of the program.
    """
    from driver.experiment.images.heightmaps import ImageError

    try:
        yield
    except PreparedError:
        raise  # what was asked for, no mistake
    except (InputError, ImageError, SolverError, SystemLibraryError, OSError) as error:
        said = _of_the_system(error) if isinstance(error, OSError) else str(error)
        for line in said.splitlines():
            # A line that begins with the file of the case says which it is.
            known = prefix and line.startswith(prefix.removesuffix(": "))
            typer.echo(f"prismid: {'' if known else prefix}{line}", err=True)
        raise typer.Exit(1) from None


def _of_the_system(error: OSError) -> str:
    """Return what the system refused: the file, and what it said."""
    if error.filename is None:
        return " ".join(str(error).split())
    found = f"{why(error)} of the system"
    return sentence(error.filename, "file", found, "one that can be read and written here")


@contextmanager
def _states() -> Iterator[Callable[[Sequence[State], int], None]]:
    """Show lines of progress; on a terminal with the states of all jobs as a table below them."""
    from rich.live import Live

    from driver.batch.progress import remaining, table

    console = Console(highlight=False, markup=False, soft_wrap=True)
    start = perf_counter()

    def show(line: str) -> None:
        console.print(f"{perf_counter() - start:7.1f} s  {line}")

    if console.is_terminal:
        with Live(console=console) as live, progress_to(show):
            yield lambda states, most: live.update(table(states, most))
        return
    tell = seldom(lambda words: show(f"    {words}"))

    def watch(states: Sequence[State], most: int) -> None:
        at_work = [f"{s.job.name} {s.stage}".rstrip() for s in states if s.status == "running"]
        waiting = sum(s.status == "waiting" for s in states)
        left = duration(remaining(states, most))
        tell(f"at work: {', '.join(at_work) or 'none'}; {waiting} waiting; about {left} left")

    with progress_to(show):
        yield watch


@contextmanager
def _progress(prefix: str = "") -> Iterator[None]:
    """Show lines of progress; on a terminal with the running step and its time below them."""
    from solver_adapters.kernels import compiled_before

    console = Console(highlight=False, markup=False, soft_wrap=True)
    start = perf_counter()
    status = console.status("starting") if console.is_terminal else None

    def show(line: str) -> None:
        console.print(f"{perf_counter() - start:7.1f} s  {prefix}{line}")
        if status is not None:
            status.update(escape(prefix + line))

    if not compiled_before():
        show("first use of this version: its kernels are compiled on the way, a minute or two more")
    if status is None:
        with progress_to(show, seldom(lambda words: show(f"    {words}"))):
            yield
    else:
        with status, progress_to(show, lambda words: status.update(escape(prefix + words))):
            yield


if __name__ == "__main__":
    app(prog_name="prismid")

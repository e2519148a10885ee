"""The command line: `prismid` with a verb, from `init` to `noise-floor`."""

from __future__ import annotations

from functools import partial
from importlib.metadata import version
from pathlib import Path
from shlex import quote
from time import time
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from driver.case.material import Crystal
from driver.case.model import (
    CASE_FILE,
    SCHEMA_FILE,
    CaseError,
    schema_text,
    write_case,
)
from driver.case.new_case import NewFiles, new_case
from driver.case.specimen import Shape
from driver.common.atomic_write import write_whole
from driver.common.errors import sentence
from driver.common.formatting import byte_size
from driver.common.stage_names import STAGE_NAMES
from driver.results.files import EXPORT
from driver.terminal.answers import answer_of_check, answer_of_run, answer_of_status, answered
from driver.terminal.endings import (
    CODES,
    Ending,
    ending_of,
    results_at,
    tell_ending,
    told_in_one_line,
)
from driver.terminal.exit_codes import FAILED
from driver.terminal.output import show_table, tell, tolerate_any_encoding
from driver.terminal.progress_display import shown_progress, shown_states
from driver.terminal.stopping import stop_at_end_of_input, stoppable

_MARKS = {"ok": "ok     ", "warning": "WARNING", "error": "ERROR  "}


class _Verbs(TyperGroup):
    """The verbs, which a signal stops."""

    def invoke(self, ctx: Any) -> Any:
        """Run one."""
        with stoppable():
            return super().invoke(ctx)


app = typer.Typer(
    cls=_Verbs,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


cache = typer.Typer(no_args_is_help=True)
app.add_typer(cache, name="cache", help="Look after the store of a solver's jobs.")


def _path(text: str) -> Path:
    """Return a path that is not empty: an empty one would be the folder of the call."""
    if not text:
        raise typer.BadParameter('found "", expected the name of a file or a folder')
    return Path(text)


def _stage(text: str) -> str:
    """Return the name of a stage."""
    if text not in STAGE_NAMES:
        expected = ", ".join(STAGE_NAMES)
        raise typer.BadParameter(f'found "{text}", expected one of {expected}')
    return text


CaseArgument = Annotated[
    Path, typer.Argument(metavar="CASE", parser=_path, help="case.toml or its folder")
]


ResultsOption = Annotated[
    Path | None,
    typer.Option(
        "--results", metavar="FOLDER", parser=_path, help="of the results, default as in the case"
    ),
]


JsonOption = Annotated[
    bool, typer.Option("--json", help="one JSON object on standard output, all else beside it")
]


StoreArgument = Annotated[
    Path,
    typer.Argument(
        metavar="FOLDER", parser=_path, help="folder of the jobs, case.toml or its folder"
    ),
]


def _show_version(wanted: bool) -> None:
    if wanted:
        tell(f"prismid {version('prismid')}")
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
    tolerate_any_encoding()
    if end_with_input:
        stop_at_end_of_input()


@app.command()
def init(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", parser=_path, help="folder of the new case")
    ],
    crystal: Annotated[
        Crystal, typer.Option(help="crystal: a BCC steel, the same with {123}, or copper")
    ] = "bcc",
    shape: Annotated[
        Shape, typer.Option(help="triangular prism, bar, or a mesh of your own")
    ] = "prism",
    frames: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="images of the test: a file, a folder or a pattern"),
    ] = None,
    repeats: Annotated[
        str | None, typer.Option(metavar="NAME", help="images before loading: the same")
    ] = None,
    flats: Annotated[
        str | None, typer.Option(metavar="NAME", help="images of a flat reference surface")
    ] = None,
    history: Annotated[
        str | None, typer.Option(metavar="NAME", help="log of times, stage travel and loads")
    ] = None,
    ebsd: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="EBSD map of both grains, of EDAX, Oxford or Bruker"),
    ] = None,
    noise_nm: Annotated[
        float | None,
        typer.Option(
            metavar="NM", help="noise of a pixel, where there are no images before loading"
        ),
    ] = None,
) -> None:
    """Write a commented case.toml, and its schema for editors, into DIR.

    Names of files are those that the case has, seen from DIR.
    """
    from driver.experiment.ebsd.headers import makers_of

    with told_in_one_line():
        path, schema = folder / CASE_FILE, folder / SCHEMA_FILE
        if folder.exists() and not folder.is_dir():
            raise CaseError(sentence(folder, "DIR", "a file", "a folder, or nothing yet"))
        for file in (path, schema):
            if file.exists() or file.is_symlink():
                raise CaseError(sentence(file, "file", "a file", "none: it is not overwritten"))
        named = NewFiles(frames, repeats, flats, history, ebsd, noise_nm)
        frame = None if ebsd is None else next(iter(makers_of(folder / ebsd)), None)
        case = new_case(path, named, crystal, shape, frame)
        folder.mkdir(parents=True, exist_ok=True)
        write_case(case, path)
        write_whole(schema, schema_text())
        tell(f"{path} written: fill it in, then `prismid check {quote(str(path))}`")


@app.command()
def check(case: CaseArgument, results: ResultsOption = None, as_json: JsonOption = False) -> None:
    """Validate CASE, its files, solver and libraries; estimate the cost; draw the set-up."""
    from driver.check.command import check as find

    file = _case_file(case)
    with answered(as_json) as answer, told_in_one_line():
        with shown_progress(err=True):
            findings = find(file, results)
        for finding in findings:
            tell(f"{_MARKS[finding.level]} {finding.subject}: {finding.message}")
        answer(answer_of_check(file, findings))
    if any(finding.level == "error" for finding in findings):
        raise typer.Exit(FAILED)


@app.command()
def run(
    cases: Annotated[
        list[Path], typer.Argument(metavar="CASE...", parser=_path, help="cases or folders")
    ],
    until: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE",
            parser=_stage,
            help="last stage to run: mesh, measure, identify, diagnose, advise or report",
        ),
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
    results: ResultsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Run the stages of one CASE or many; what is done and unchanged is not done again."""
    from driver.workflow import pipeline

    if results is not None and len(cases) > 1:
        raise typer.BadParameter("found several cases, expected one", param_hint="--results")
    endings: list[tuple[Path, Path, Ending]] = []
    with answered(as_json) as answer:
        for case in cases:
            # A bad case does not keep the next one from running.
            file, prefix = _case_file(case), f"{case}: " if len(cases) > 1 else ""
            folder = results_at(file, results)
            asked = (file, until, force, prepare_only, processes, threads, store, results)
            with shown_progress(prefix):
                ending = ending_of(partial(pipeline.run, *asked), folder)
            endings.append((case, folder, ending))
            tell_ending(str(case), ending, prefix)
        if len(cases) > 1:
            tell(", ".join(f"{case} {ending.status}" for case, _, ending in endings))
        answer(answer_of_run(endings))
    code = max(CODES[ending.status] for _, _, ending in endings)
    if code:
        raise typer.Exit(code)


@app.command()
def status(case: CaseArgument, results: ResultsOption = None, as_json: JsonOption = False) -> None:
    """Say how far CASE is: its stages, the run that is at work, the verdict."""
    from driver.status.command import lines_of, status_of

    with answered(as_json) as answer, told_in_one_line():
        found = status_of(_case_file(case), results)
        for line in lines_of(found):
            tell(line)
        answer(answer_of_status(found))


@app.command()
def batch(
    campaign: Annotated[
        Path, typer.Argument(metavar="CAMPAIGN", parser=_path, help="file of the campaign")
    ],
) -> None:
    """Run the cases of CAMPAIGN beside one another; compare what they came to."""
    from driver.batch.command import batch as run_all

    with told_in_one_line(), shown_states() as watch:
        done = run_all(campaign, watch)
    if not done:
        raise typer.Exit(FAILED)


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

    with told_in_one_line():
        path = _case_file(file)
        requests = asked_for(path)
        if not requests:
            tell(f"{path}: nothing to agree to")
            return
        for request in requests:
            tell(shown(request))
        if not yes:
            typer.confirm("Agree?", abort=True)
        tell(agreed(path, requests))


@app.command()
def report(
    case: CaseArgument,
    results: ResultsOption = None,
    figures: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", parser=_path, help="write the figures there, too, as PDF and SVG"
        ),
    ] = None,
) -> None:
    """Write the report page of CASE anew from its results."""
    from driver.workflow import pipeline

    with told_in_one_line(), shown_progress():
        pipeline.report(_case_file(case), results, figures)


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
    results: ResultsOption = None,
) -> None:
    """Write the results of CASE in the formats of other programs."""
    from driver.export.command import export_case

    path = _case_file(case)
    folder = to if to is not None else results_at(path, results) / EXPORT
    with told_in_one_line(), shown_progress():
        export_case(path, folder, volume, med, results)


@app.command()
def verify(
    results: Annotated[
        Path,
        typer.Argument(
            metavar="RESULTS", parser=_path, help="folder of results, case.toml or its folder"
        ),
    ],
    until: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE",
            parser=_stage,
            help="last stage to compute, default all that have results",
        ),
    ] = None,
    of_case: ResultsOption = None,
) -> None:
    """Compute RESULTS anew, elsewhere, and compare every number; exit code 1 if any differs."""
    from driver.verify.command import table_of, told
    from driver.verify.command import verify as compare

    with told_in_one_line():
        with shown_progress():
            found = compare(results, until, of_case)
        show_table(table_of(found))
        told(found, tell)
    if not found.agrees:
        raise typer.Exit(FAILED)


@app.command("noise-floor")
def noise_floor(case: CaseArgument) -> None:
    """Measure what the correlation of CASE can see: errors against mesh size, the mesh to take."""
    from driver.noise_floor.command import noise_floor as measure

    with told_in_one_line(), shown_progress():
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

    with told_in_one_line(), shown_progress():
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

    with told_in_one_line(), shown_progress():
        foresee(_case_file(case), settings, change or (), usual)


@app.command()
def posterior(
    case: CaseArgument,
    draws: Annotated[int, typer.Option(min=50, help="parameter sets that are simulated")] = 300,
    seed: Annotated[int, typer.Option(min=0, help="of the draws")] = 0,
    results: ResultsOption = None,
) -> None:
    """Sample the posterior of the identified parameters of CASE, beside their Gaussian σ."""
    from driver.posterior.command import posterior as sample

    with told_in_one_line(), shown_progress():
        sample(_case_file(case), draws, seed, results)


@cache.command("list")
def cache_list(where: StoreArgument = Path()) -> None:
    """Show the jobs of a store: solver, state, size, last use, and the case that asked for it."""
    from driver.cache.command import jobs_at, table_of, total_of

    with told_in_one_line():
        store, jobs = jobs_at(where)
        if jobs:
            show_table(table_of(jobs, time()))
        tell(total_of(store, jobs))


@cache.command("verify")
def cache_verify(where: StoreArgument = Path()) -> None:
    """Compare the jobs of a store with their keys and checksums, and name what does not match."""
    from driver.cache.command import jobs_at, verified, verify

    with told_in_one_line():
        store, jobs = jobs_at(where)
        whole, faulty = verify(jobs, tell)
        tell(verified(store, whole, faulty))
    if faulty:
        raise typer.Exit(FAILED)


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

    with told_in_one_line():
        store, jobs = jobs_at(where)
        chosen = to_prune(jobs, failed, older_than, time())
        if not chosen:
            tell(f"{store}: nothing to remove")
            return
        show_table(table_of(chosen, time()))
        if not yes:
            typer.confirm(f"Remove {pruned(chosen)}?", abort=True)
        freed = prune(chosen, tell)
        tell(f"{store}: {byte_size(freed)} freed")


def _case_file(case: Path) -> Path:
    """Return the case file, where the folder of the case was given."""
    return case / CASE_FILE if case.is_dir() else case


if __name__ == "__main__":
    app(prog_name="prismid")

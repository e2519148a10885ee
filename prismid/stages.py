"""The verbs of the command line that work on a case."""

from __future__ import annotations

from pathlib import Path

from driver.check import command as check_command
from driver.doubts.finding import Finding
from driver.export import command as export_command
from driver.workflow import pipeline
from prismid.cases import CaseLike, file_of


def run(
    case: CaseLike,
    until: str | None = None,
    force: bool = False,
    prepare_only: bool = False,
    processes: int | None = None,
    threads: int | None = None,
    store: Path | str | None = None,
) -> None:
    """Run the stages of a case; what is done and unchanged is not done again.

    Args:
        case: the case, its file or its folder.
        until: last stage to run: "mesh", "measure", "identify", "diagnose", "advise" or "report";
            None for all.
        force: run the stages even if they are done and unchanged.
        prepare_only: whether external solvers write their jobs for another machine.
        processes: simulations side by side, None for those of the case. A script that is run
            with several needs `if __name__ == "__main__":` around its calls.
        threads: threads of each process, None for those of the case.
        store: folder of the jobs of a solver that is a program of its own, None for that of the
            case.

    Raises:
        InputError: the case, a measured file or `until` cannot be used.
        PreparedError: jobs were written for another machine, which `prepare_only` asks for.
        SolverError: a simulation could not be finished.

    Examples:
        >>> import prismid
        >>> prismid.run("alpha", until="measure")
    """
    place = None if store is None else Path(store)
    pipeline.run(file_of(case), until, force, prepare_only, processes, threads, place)


def report(case: CaseLike) -> None:
    """Write the report page of a case anew from its results.

    Args:
        case: the case, its file or its folder.

    Raises:
        InputError: a stage before it has no results, or such as are of another state of the case.
    """
    pipeline.report(file_of(case))


def check(case: CaseLike) -> list[Finding]:
    """Validate a case, its files, solver and libraries; estimate the cost; draw the set-up.

    Args:
        case: the case, its file or its folder.

    Returns:
        what was found, each with a `level` ("ok", "warning", "error"), `subject` and `message`.

    Raises:
        InputError: values of the case were changed since it was read; else nothing is raised for
            bad input: it is found.
    """
    return check_command.check(file_of(case))


def export_case(case: CaseLike, folder: Path | str, volume: bool = True, med: bool = False) -> None:
    """Write the finished results of a case in the formats of other programs.

    Args:
        case: the case, its file or its folder.
        folder: where to write; files of an earlier export are replaced, others left alone.
        volume: whether to write the fields of the volume, for which each model is simulated once
            more.
        med: whether to write them as MED, too.

    Raises:
        InputError: the case has no images or no results, or the folder cannot take them.
        SolverError: a simulation for the volume could not be finished.
    """
    export_command.export_case(file_of(case), Path(folder), volume, med)

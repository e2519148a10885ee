"""What Code_Aster's listing says: how the run ended and why, and which time steps it took.

Verdicts and exceptions are those of `run_aster/status.py`, which takes a kill for a lack of time:
that verdict alone says nothing. Messages are known by their names, which
are the same in every language; their sentences are those of the catalogues JEVEUX, JEVEUX1 and
FACTOR in French, which every version prints where no translation is installed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from solver_adapters.external import Status
from solver_adapters.jobs.runner import KILL_CODES

_VERDICT = re.compile(r"^--- DIAGNOSTIC JOB : (.*)$", re.MULTILINE)
_EXIT = re.compile(r"^EXECUTION_CODE_ASTER_EXIT_\d+=(-?\d+)", re.MULTILINE)
_TIME_IS_UP = 128 + 24  # the exit code of SIGXCPU, of the limit that run_aster sets
# What is said on the level of an alarm, <A>, ends no run.
_FATAL = r"<(?:F|S|E|EXCEPTION|[A-Z]\w*Error)> "
_BROKEN = re.compile(
    r"^\S*(?:ImportError|ModuleNotFoundError)\b|cannot open shared object file"
    r"|error while loading shared libraries|^\S*run_aster: .*(?:No such file|not found)",
    re.MULTILINE,
)
_OUT_OF_MEMORY = re.compile(
    r"MEMOIRE INSUFFISANTE POUR ALLOUER|<JEVEUX1?_6[02]>|<JEVEUX1_71>|_MEMORY_ERROR"
    rf"|{_FATAL}<FACTOR_(?:53|54|58|64|85)>|\bMemoryError\b|std::bad_alloc"
    r"|[Cc]annot allocate memory|oom-kill|Out of memory"
)
_OUT_OF_DISK = re.compile(
    rf"{_FATAL}<FACTOR_66>|<JEVEUX_40>|No space left on device|Disk quota exceeded"
    r"|Aucun espace disponible"
)
_OUT_OF_TIME = re.compile(
    r"<TimeLimitError>|<ArretCPUError>|ARRET PAR MANQUE DE TEMPS|CPU time limit exceeded|SIGXCPU"
    r"|\btimed out after ",
    re.IGNORECASE,
)
# Singular or imprecise systems are of the parameters, as steps without convergence are.
_NOT_CONVERGED = re.compile(
    r"<(?:ConvergenceError|IntegrationError|SolverError|ContactError)>|_NO_CONVERGENCE"
    r"|libaster\.(?:ConvergenceError|IntegrationError|SolverError)"
    rf"|{_FATAL}<FACTOR_(?:10|11|12|42|57|78|79)>"
)
_CRASHED = re.compile(rf"{_FATAL}<FACTOR_55>|Segmentation fault|SIGSEGV|Erreur de segmentation")
_BAD_DECK = re.compile(
    r"SyntaxError|CheckerError|<(?:EXCEPTION|AsterError)>|<F> <\w+>|<[FS]>_ERROR|_SYNTAX_ERROR"
    r"|^Traceback \(most recent call last\)",
    re.MULTILINE,
)
# The first that is found names the cause: a lack of memory also ends in an exception.
_CAUSES = (
    (_OUT_OF_MEMORY, Status.OUT_OF_MEMORY),
    (_OUT_OF_DISK, Status.OUT_OF_DISK),
    (_OUT_OF_TIME, Status.OUT_OF_TIME),
    (_NOT_CONVERGED, Status.NOT_CONVERGED),
    (_CRASHED, Status.CRASHED),
    (_BROKEN, Status.BROKEN),
    (_BAD_DECK, Status.BAD_DECK),
)
# Warnings and unchecked values do not spoil a result.
_COMPLETED = ("OK", "<A>_ALARM", "NO_TEST_RESU", "NOOK_TEST_RESU")

# A message in its box, and the error of a Python command with the place in the command file.
_MESSAGE = re.compile(rf"^ *║ *{_FATAL}.*(?:\n *║.*){{0,40}}", re.MULTILINE)
_PYTHON = re.compile(
    r"^ *File .*\n(?:(?! *File )[^\n]*\n){0,4}?(?:\w+\.)*\w*(?:Error|Exception)\b[^\n]*",
    re.MULTILINE,
)
_MOST_LINES = 12

_INSTANT = re.compile(r"(?:Time of computation|Instant de calcul)\s*:\s*(\S+)")
_ITERATIONS = re.compile(r"^\* Nombre d'itérations de Newton\s*:\s*(\d+)", re.MULTILINE)
_CONVERGED = re.compile(r"of convergence reached|de convergence atteint")


def diagnose(log: str) -> Status:
    """How a run ended; DONE where the log says nothing of a failure.

    Args:
        log: listing of Code_Aster or output of run_aster, whole or its end.
    """
    verdicts = [verdict.rstrip() for verdict in _VERDICT.findall(log)]
    if verdicts and verdicts[-1] in _COMPLETED:
        return Status.DONE
    for pattern, status in _CAUSES:
        if pattern.search(log):
            return status
    codes = [int(code) for code in _EXIT.findall(log)]
    if codes and codes[-1] == _TIME_IS_UP:
        return Status.OUT_OF_TIME
    if codes and codes[-1] in KILL_CODES:
        return Status.KILLED
    return Status.CRASHED if verdicts else Status.DONE


def cause(log: str) -> str:
    """Return the first message of an error in a log, without its box; "" where there is none."""
    found = [match for kind in (_MESSAGE, _PYTHON) if (match := kind.search(log))]
    if not found:
        return ""
    first = min(found, key=lambda match: match.start())[0]
    lines = [line.strip(" ║") if "║" in line else line.rstrip() for line in first.splitlines()]
    return "\n".join([line for line in lines if line][:_MOST_LINES])


@dataclass(frozen=True)
class Steps:
    """The time steps of a run.

    Attributes:
        ends: their ends [s], in the order in which they were taken.
        iterations: Newton iterations in all, those of failed attempts too.
        cuts: attempts that failed and were cut.
    """

    ends: tuple[float, ...]
    iterations: int
    cuts: int


def steps_taken(text: str) -> Steps:
    """Return the time steps that a listing tells of.

    Raises:
        ValueError: an instant or a count is no number.
    """
    _, *attempts = _INSTANT.split(text)
    instants, bodies = attempts[::2], attempts[1::2]
    converged = [_CONVERGED.search(body) is not None for body in bodies]
    ends = tuple(float(instant) for instant, done in zip(instants, converged, strict=True) if done)
    # The count of a step comes first; after the last step follows that of the run.
    counts = [_ITERATIONS.search(body) for body in bodies]
    iterations = sum(int(count[1]) for count in counts if count)
    return Steps(ends, iterations, len(bodies) - len(ends))

"""What Code_Aster's listing says: how the run ended, and which time steps it took.

Verdicts and exceptions are those of `run_aster/status.py`; the messages about memory are those of
its catalogue (JEVEUX_60, JEVEUX_62, FACTOR_53, FACTOR_54, FACTOR_64) in French, which every
version prints where no translation is installed.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from solver_adapters.external import Status

_VERDICT = re.compile(r"^--- DIAGNOSTIC JOB : (.*?)\s*$", re.MULTILINE)
_OUT_OF_MEMORY = re.compile(
    r"MEMOIRE INSUFFISANTE POUR ALLOUER|<JEVEUX1?_6[02]>|<FACTOR_(53|54|64)>|_MEMORY_ERROR"
    r"|\bMemoryError\b|std::bad_alloc|[Cc]annot allocate memory|oom-kill|Out of memory"
)
_OUT_OF_TIME = re.compile(
    r"<TimeLimitError>|<ArretCPUError>|ARRET PAR MANQUE DE TEMPS|_CPU_LIMIT"
    r"|CPU time limit exceeded|SIGXCPU",
    re.IGNORECASE,
)
_NOT_CONVERGED = re.compile(
    r"<(ConvergenceError|IntegrationError|SolverError|ContactError)>|_NO_CONVERGENCE"
    r"|libaster\.(ConvergenceError|IntegrationError|SolverError)"
)
_BAD_DECK = re.compile(
    r"SyntaxError|CheckerError|<(EXCEPTION|AsterError)>|<F> <\w+>|<[FS]>_ERROR|_SYNTAX_ERROR"
    r"|^Traceback \(most recent call last\)",
    re.MULTILINE,
)
# The first that is found names the cause: a lack of memory also ends in an exception.
_CAUSES = (
    (_OUT_OF_MEMORY, Status.OUT_OF_MEMORY),
    (_OUT_OF_TIME, Status.OUT_OF_TIME),
    (_NOT_CONVERGED, Status.NOT_CONVERGED),
    (_BAD_DECK, Status.BAD_DECK),
)
# Warnings and unchecked values do not spoil a result.
_COMPLETED = ("OK", "<A>_ALARM", "NO_TEST_RESU", "NOOK_TEST_RESU")

_INSTANT = re.compile(r"(?:Time of computation|Instant de calcul)\s*:\s*(\S+)")
_ITERATIONS = re.compile(r"^\* Nombre d'itérations de Newton\s*:\s*(\d+)", re.MULTILINE)
_CONVERGED = re.compile(r"of convergence reached|de convergence atteint")


def diagnose(log: str) -> Status:
    """How a run ended; DONE where the log says nothing of a failure.

    Args:
        log: listing of Code_Aster or output of run_aster, whole or its end.
    """
    verdicts = _VERDICT.findall(log)
    if verdicts and verdicts[-1] in _COMPLETED:
        return Status.DONE
    for pattern, status in _CAUSES:
        if pattern.search(log):
            return status
    return Status.KILLED if verdicts else Status.DONE


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
    """The time steps that a listing tells of."""
    _, *attempts = _INSTANT.split(text)
    instants, bodies = attempts[::2], attempts[1::2]
    converged = [_CONVERGED.search(body) is not None for body in bodies]
    ends = tuple(float(instant) for instant, done in zip(instants, converged, strict=True) if done)
    # The count of a step comes first; after the last step follows that of the run.
    counts = [_ITERATIONS.search(body) for body in bodies]
    iterations = sum(int(count[1]) for count in counts if count)
    return Steps(ends, iterations, len(bodies) - len(ends))

"""Verdicts and time steps of real listings of Code_Aster 15.2 (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import gzip
import time

import numpy as np
import pytest

from solver_adapters.code_aster.listing import cause, diagnose, steps_taken
from solver_adapters.external import Status
from tools.code_aster_cases import DATA
from tools.code_aster_prism import forces


def listing(name: str) -> str:
    return gzip.decompress((DATA / "logs" / f"{name}.log.gz").read_bytes()).decode("utf-8")


VERDICTS = {
    "prism_done": Status.DONE,
    "no_convergence": Status.NOT_CONVERGED,
    "cpu_limit": Status.OUT_OF_TIME,
    "syntax_error": Status.BAD_DECK,
}


@pytest.mark.parametrize(("name", "status"), VERDICTS.items())
def test_the_status_of_a_real_listing_is_its_verdict(name: str, status: Status) -> None:
    assert diagnose(listing(name)) == status


@pytest.mark.parametrize(("name", "status"), VERDICTS.items())
def test_the_listing_tells_the_cause_without_its_verdict(name: str, status: Status) -> None:
    head, _, _ = listing(name).partition("WARNING: execution failed")
    assert diagnose(head.partition("--- DIAGNOSTIC JOB")[0]) == status


@pytest.mark.parametrize(
    "line",
    [
        " <F> <JEVEUX_62> Erreur lors de l'allocation dynamique.",
        "MEMOIRE INSUFFISANTE POUR ALLOUER 800 Mo",
        " ║ <EXCEPTION> <FACTOR_54> ║",
        "MemoryError: Unable to allocate 2.1 GiB",
    ],
)
def test_a_lack_of_memory_is_told_from_other_exceptions(line: str) -> None:
    """The messages are those of Code_Aster's catalogue (bibpyt/Messages) and of Python."""
    end = "Traceback (most recent call last):\n--- DIAGNOSTIC JOB : <F>_ERROR\n"
    assert diagnose(f"{line}\n{end}") == Status.OUT_OF_MEMORY


@pytest.mark.parametrize(
    ("code", "status"),
    [
        (139, Status.CRASHED),
        (134, Status.CRASHED),
        (1, Status.CRASHED),
        (137, Status.KILLED),
        (-9, Status.KILLED),
        (143, Status.KILLED),
        (152, Status.OUT_OF_TIME),
    ],
)
def test_an_end_without_a_word_is_told_by_the_exit_code_of_the_program(
    code: int, status: Status
) -> None:
    end = f"EXECUTION_CODE_ASTER_EXIT_812={code}\n\n--- DIAGNOSTIC JOB : <F>_ABNORMAL_ABORT\n"
    assert diagnose(f"Time of computation: 1.0\n{end}") == status


def test_a_kill_that_run_aster_takes_for_a_lack_of_time_is_none() -> None:
    """It gives the verdict to every program that SIGKILL ended (its `get_status`)."""
    end = "EXECUTION_CODE_ASTER_EXIT_812=-9\n\n--- DIAGNOSTIC JOB : <S>_CPU_LIMIT\n"
    assert diagnose(end) == Status.KILLED
    assert diagnose("Command 'ulimit …' timed out after 12 seconds" + end) == Status.OUT_OF_TIME


@pytest.mark.parametrize(
    ("line", "status"),
    [
        (" ║ <F> <JEVEUX1_71>  ║", Status.OUT_OF_MEMORY),
        (" ║ <EXCEPTION> <FACTOR_66> ║", Status.OUT_OF_DISK),
        ("OSError: [Errno 28] No space left on device", Status.OUT_OF_DISK),
        (" ║ <EXCEPTION> <JEVEUX_40> ║", Status.OUT_OF_DISK),
        (" ║ <EXCEPTION> <FACTOR_55> ║", Status.CRASHED),
        *((f" ║ <EXCEPTION> <FACTOR_{n}> ║", Status.NOT_CONVERGED) for n in (10, 11, 12, 42, 57)),
        ("ImportError: libmed.so.11: cannot open shared object file", Status.BROKEN),
        ("ModuleNotFoundError: No module named 'libaster'", Status.BROKEN),
        ("NameError: name 'TAU0' is not defined", Status.BAD_DECK),
    ],
)
def test_what_is_no_fault_of_the_deck_is_not_told_as_one(line: str, status: Status) -> None:
    end = "Traceback (most recent call last):\n  x\n" + line + "\n--- DIAGNOSTIC JOB : <F>_ERROR\n"
    assert diagnose(end) == status


def test_an_alarm_with_the_number_of_an_error_ends_no_run() -> None:
    alarm = " ║ <A> <FACTOR_57> ║\n ║ <A> <FACTOR_10> ║\n"
    assert diagnose(alarm + "--- DIAGNOSTIC JOB : <S>_ERROR\n") == Status.BAD_DECK
    assert diagnose(alarm + "--- DIAGNOSTIC JOB : <A>_ALARM\n") == Status.DONE


CAUSES = {
    "prism_done": "",
    "no_convergence": "<IntegrationError> <MECANONLINE9_3>\nStop following the failure of the int",
    "cpu_limit": "<TimeLimitError> <MECANONLINE9_2>\nArrêt par manque de temps CPU",
    "syntax_error": "<EXCEPTION> <SUPERVIS_4>\nErreur de syntaxe dans DEFI_COMPOR\nFor keyword",
}


@pytest.mark.parametrize(("name", "words"), CAUSES.items())
def test_the_cause_is_the_first_message_of_an_error_without_its_box(name: str, words: str) -> None:
    found = cause(listing(name))
    assert found.startswith(words) and bool(found) == bool(words)
    assert "║" not in found and len(found.splitlines()) <= 12


def test_an_error_of_python_is_the_cause_with_its_place() -> None:
    text = (
        "some output\nTraceback (most recent call last):\n"
        '  File "/path/to/code_aster/run.py", line 9, in run\n    exec(text)\n'
        '  File "job.comm.changed.py", line 87\n    44,,\n       ^\n'
        "SyntaxError: invalid syntax\n# ---\nTotal 0.1\n"
    )
    found = cause(text)
    assert found.startswith('  File "job.comm.changed.py", line 87')
    assert found.endswith("SyntaxError: invalid syntax")


def test_a_listing_that_grows_tells_the_steps_that_converged_wherever_it_breaks_off() -> None:
    text = listing("prism_done")
    begun, _, _ = text.partition("Time of computation:   1.025000000000e+01")
    # A step to 10.5 s has failed, and is to be cut.
    assert steps_taken(begun).ends[-1] == 10.0
    begin, taken = len(begun), steps_taken(text).ends
    for end in range(begin, begin + 3000):
        assert steps_taken(text[begin - 20_000 : end]).ends[-1] in taken
    assert steps_taken("Mesh read").ends == ()


def test_a_warning_about_memory_does_not_spoil_a_run_that_reached_its_end() -> None:
    text = "<A> <JEVEUX1_64> 100.00 fois\nCannot allocate memory\n--- DIAGNOSTIC JOB : <A>_ALARM\n"
    assert diagnose(text) == Status.DONE


def test_the_listing_tells_every_step_that_was_taken() -> None:
    steps = steps_taken(listing("prism_done"))
    # The table of steps of the same run, made apart from this listing with ten digits.
    np.testing.assert_allclose(steps.ends, forces()[0][1:], rtol=1e-9)
    assert (len(steps.ends), steps.cuts, steps.iterations) == (45, 5, 174)


def test_a_listing_in_french_is_understood() -> None:
    text = listing("prism_done").replace("Time of computation", "Instant de calcul")
    text = text.replace(
        "Criterion (S) of convergence reached (S)", "Critère de convergence atteint"
    )
    assert steps_taken(text) == steps_taken(listing("prism_done"))


def test_an_empty_listing_has_no_steps() -> None:
    assert steps_taken("").ends == ()


def test_a_listing_of_boxes_that_never_end_is_read_in_linear_time() -> None:
    """Each box was once sought to the end of the text: hours for some megabytes."""
    box = "║ <S> <MECA_1> something ║\n"
    counted = []
    for count in (2_000, 20_000):
        begun = time.process_time()
        assert cause(box * count).startswith("<S> <MECA_1> something")
        assert diagnose("--- DIAGNOSTIC JOB : " + " " * count + "x") == Status.CRASHED
        counted.append(time.process_time() - begun)
    assert counted[1] < 50 * counted[0] + 0.1

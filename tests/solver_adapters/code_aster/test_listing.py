"""Verdicts and time steps of real listings of Code_Aster 15.2 (tests/data/solver/ORIGIN.md)."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

from benchmarks.code_aster_prism import forces
from solver_adapters.code_aster.listing import diagnose, steps_taken
from solver_adapters.external import Status
from tests.solver_adapters.code_aster.cases import DATA


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


def test_an_end_without_a_word_of_its_cause_is_that_of_a_killed_program() -> None:
    text = "Time of computation: 1.0\n--- DIAGNOSTIC JOB : <F>_ABNORMAL_ABORT\n"
    assert diagnose(text) == Status.KILLED


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

"""Examples of the docstrings, run as they stand, on a small case in the current folder."""

from __future__ import annotations

import doctest
import inspect
from pathlib import Path

import pytest

import prismid

FUNCTIONS = [
    name
    for name in prismid.__all__
    if inspect.isfunction(getattr(prismid, name))
    and ">>>" in (getattr(prismid, name).__doc__ or "")
]
# Their examples stand in docs/python.md, or they need none.
WITHOUT = {
    "bunge_matrix", "check", "correlate", "correlate_incrementally", "default_case", "export_case",
    "orientations_of", "progress_to", "read_hdf5", "report", "results_of", "write_case",
}  # fmt: skip


def test_every_function_has_an_example_but_those_of_the_page() -> None:
    every = {name for name in prismid.__all__ if inspect.isfunction(getattr(prismid, name))}
    assert every - set(FUNCTIONS) == WITHOUT


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_example_of_a_docstring_gives_what_it_says(name: str, alpha: Path) -> None:
    function = getattr(prismid, name)
    found = doctest.DocTestFinder(recurse=False).find(function, name, globs={})
    runner = doctest.DocTestRunner()
    assert [runner.run(test).failed for test in found] == [0]

"""What the package offers, and the page and the notebook that show it."""

from __future__ import annotations

import ast
import inspect
from pathlib import Path

import pytest

import prismid

SOURCE = Path(str(prismid.__file__))


def test_every_name_that_is_offered_is_there_and_says_what_it_does() -> None:
    for name in prismid.__all__:
        assert getattr(prismid, name).__doc__
    assert set(prismid.__all__) <= set(dir(prismid))


def test_what_type_checkers_see_is_what_is_loaded() -> None:
    tree = ast.parse(SOURCE.read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    seen = {
        alias.name: statement.module
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
    assert seen == prismid._MODULES
    assert sorted(seen) == prismid.__all__


def test_an_unknown_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="module 'prismid' has no attribute 'corelate'"):
        prismid.corelate  # noqa: B018


def test_every_function_is_typed_through_and_through() -> None:
    for name in prismid.__all__:
        function = getattr(prismid, name)
        if inspect.isfunction(function):
            told = inspect.signature(function)
            assert told.return_annotation is not inspect.Signature.empty
            kinds = (parameter.annotation for parameter in told.parameters.values())
            assert inspect.Parameter.empty not in kinds


@pytest.mark.parametrize("package", ["prismid", "driver", "meshes", "solver_adapters", "templates"])
def test_type_checkers_of_users_are_told_of_the_types(package: str) -> None:
    assert (SOURCE.parents[1] / package / "py.typed").is_file()

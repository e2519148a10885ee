from collections.abc import Iterator
from pathlib import Path

import jinja2
import pytest

import templates
from templates import render


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(templates._ENVIRONMENT, "loader", jinja2.FileSystemLoader(tmp_path))
    cache = templates._ENVIRONMENT.cache
    assert cache is not None
    cache.clear()
    yield tmp_path
    cache.clear()


def test_values_are_escaped_in_pages_only(folder: Path) -> None:
    for name in ("page.html.j2", "deck.comm.j2"):
        (folder / name).write_text("{{ value }}\n")
    assert render("page.html.j2", value="a < b") == "a &lt; b\n"
    assert render("deck.comm.j2", value="a < b") == "a < b\n"


def test_a_value_that_is_not_given_is_an_error(folder: Path) -> None:
    (folder / "deck.j2").write_text("{{ given }} {{ forgotten }}")
    with pytest.raises(jinja2.UndefinedError, match="forgotten"):
        render("deck.j2", given=1)


def test_the_last_line_break_of_a_deck_is_kept(folder: Path) -> None:
    (folder / "deck.j2").write_text("FIN();\n")
    assert render("deck.j2") == "FIN();\n"

"""Solver decks, case files and report pages as Jinja2 templates, and the one way to render them."""

from __future__ import annotations

import json
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined


def _is_page(name: str | None) -> bool:
    return name is not None and name.endswith(".html.j2")


_ENVIRONMENT = Environment(
    loader=FileSystemLoader(Path(__file__).parent),
    undefined=StrictUndefined,
    autoescape=_is_page,
    keep_trailing_newline=True,
    trim_blocks=True,
    lstrip_blocks=True,
)
# A JSON text, number, boolean or list is the same value in TOML.
_ENVIRONMENT.filters["toml"] = lambda value: json.dumps(value, ensure_ascii=False)


def render(name: str, **context: object) -> str:
    """Render a template of this folder.

    Args:
        name: file name, for example ``case.toml.j2``; values are HTML-escaped in ``.html.j2`` only.
        context: the values that the template names.

    Raises:
        jinja2.TemplateNotFound: there is no such template.
        jinja2.UndefinedError: the template names a value that the context lacks.
    """
    return _ENVIRONMENT.get_template(name).render(**context)

"""What `mkdocs.yml` asks for beyond its extensions: pages beside `docs/`, and formulas as MathML.

Links are written for a forge, where a page may lead out of `docs/`: `../benchmarks/dic.md`. A file
that a page of the site leads to becomes part of the site below `repository/`, a page where it is
Markdown and else a file; so do those that these lead to in turn.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from html import unescape
from pathlib import Path
from urllib.parse import unquote

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

BESIDE = "repository"
"""Folder of the site for what lies beside `docs/`."""
LINK = re.compile(r"(?<=\]\()(?P<path>[^)\s#:]+)(?=[)#])")
FORMULA = re.compile(r'<div class="arithmatex">\\\[(?P<latex>.*?)\\\]</div>', re.DOTALL)
TAG = re.compile(r"\\tag\{(?P<number>\d+)\}")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Take in what the pages lead to outside of the folder of the documentation."""
    documents = Path(config.docs_dir)
    waiting = [documents / file.src_uri for file in files.documentation_pages()]
    while waiting:
        for path in _linked(waiting.pop(), documents.parent):
            name = _name(path, documents)
            if not path.is_relative_to(documents) and files.get_file_from_path(name) is None:
                files.append(File.generated(config, name, abs_src_path=str(path)))
                if path.suffix == ".md":
                    waiting.append(path)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write the links of a page, which hold in the repository, as they hold in the site."""
    documents = Path(config.docs_dir)
    source = page.file.abs_src_path
    assert source is not None, page.file.src_uri

    def moved(link: re.Match[str]) -> str:
        name = _name(_target(Path(source), link["path"]), documents)
        if files.get_file_from_path(name) is None:
            return link["path"]
        return os.path.relpath(name, os.path.dirname(page.file.src_uri))

    return LINK.sub(moved, markdown)


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Draw formulas as MathML, which browsers show without a script, with the number beside."""
    return FORMULA.sub(_drawn, html)


def _linked(page: Path, repository: Path) -> Iterator[Path]:
    """Files of the repository that a page leads to."""
    for link in LINK.finditer(page.read_text(encoding="utf-8")):
        path = _target(page, link["path"])
        if path.is_file() and path.is_relative_to(repository):
            yield path


def _name(path: Path, documents: Path) -> str:
    """Name in the site of a file of the repository."""
    if path.is_relative_to(documents):
        return path.relative_to(documents).as_posix()
    return f"{BESIDE}/{os.path.relpath(path, documents.parent)}"


def _target(page: Path, link: str) -> Path:
    return Path(os.path.normpath(page.parent / unquote(link)))


def _drawn(formula: re.Match[str]) -> str:
    latex = unescape(formula["latex"])
    number = TAG.search(latex)
    mathml = convert(TAG.sub("", latex).strip(), display="block")
    beside = f'<span class="number">({number["number"]})</span>' if number else ""
    return f'<div class="formula">{mathml}{beside}</div>'

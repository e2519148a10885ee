"""The site of the documentation is built strictly; the case of its tutorial is one."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from driver.case.model import load_case
from driver.experiment.history import read_history
from driver.experiment.orientations import orientations_of
from tests.driver.ebsd_files import grid, halves, write_ang

ROOT = Path(__file__).resolve().parents[1]
PAGES = ("tutorial", "loads-alone", "own-cause")
TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The site, of which no link and no anchor may lead nowhere."""
    to = tmp_path_factory.mktemp("site")
    call = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(to)]
    done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return to


def test_every_formula_is_drawn_with_its_number(site: Path) -> None:
    for source in (ROOT / "docs" / "method").glob("*.md"):
        text = source.read_text("utf-8")
        name = "index" if source.stem == "README" else source.stem
        page = (site / "method" / f"{name}.html").read_text("utf-8")
        assert page.count("<math ") == len(re.findall(r"^\$\$", text, re.MULTILINE))
        assert "$$" not in page
        numbers = re.findall(r'class="number">\((\d+)\)<', page)
        assert numbers == re.findall(r"\\tag\{(\d+)\}", text)


def test_files_beside_the_documentation_are_part_of_the_site(site: Path) -> None:
    page = (site / "method" / "simulation_error.html").read_text("utf-8")
    assert 'href="../repository/benchmarks/numerics.html"' in page
    assert (site / "repository" / "benchmarks" / "numerics.html").is_file()
    assert (site / "repository" / "examples" / "notebook.ipynb").is_file()


def test_the_site_asks_no_other_server_for_scripts_styles_or_pictures(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not re.search(r'(src="|<link [^>]*href=")(https?:)?//', page.read_text("utf-8"))


@pytest.mark.parametrize("page", PAGES)
def test_the_examples_of_a_guide_are_toml(page: str) -> None:
    text = (ROOT / "docs" / f"{page}.md").read_text("utf-8")
    blocks = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    assert blocks and all(tomllib.loads(block) for block in blocks)


def test_the_keys_of_the_tutorial_are_a_case_whose_log_is_read(tmp_path: Path) -> None:
    blocks = re.findall(r"```toml\n(.*?)```", TUTORIAL, re.DOTALL)
    (tmp_path / "case.toml").write_text("\n".join(blocks), encoding="utf-8")
    (log,) = re.findall(r"```text\n(.*?)```", TUTORIAL, re.DOTALL)
    (tmp_path / "test12.csv").write_text(log, encoding="utf-8")
    x, y = grid(16, 24)
    write_ang(tmp_path / "map.ang", x, y, halves(x, 6.0))
    case = load_case(tmp_path / "case.toml")
    history = read_history(case.path(case.history.file), stated=case.history)
    assert orientations_of(case).shape == (2, 3, 3)
    assert history.time.tolist() == pytest.approx([0.0, 10.0, 40.0], abs=0.01)
    assert history.stage.tolist() == pytest.approx([0.0, 5.0, 5.0])

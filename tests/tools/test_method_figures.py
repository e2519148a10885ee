from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest
from PIL import Image

from driver.diagnosis.answer.verdict import LEAST_EXPLAINED, Kind
from tools.method_figures import FIGURES, FOLDER, draw_all, kind_of

LARGEST = 80_000  # bytes of a figure


def test_all_figures_are_drawn(tmp_path: Path) -> None:
    draw_all(tmp_path)
    assert {path.stem for path in tmp_path.iterdir()} == set(FIGURES)
    for name in FIGURES:
        with (
            Image.open(tmp_path / f"{name}.png") as picture,
            Image.open(FOLDER / f"{name}.png") as committed,
        ):
            assert picture.size == committed.size


def test_each_page_has_its_own_figure_and_no_other_stands_in_the_folder() -> None:
    pages = [path for path in FOLDER.glob("*.md") if path.name != "README.md"]
    for page in pages:
        shown = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
        assert shown == [f"{page.stem}.png"]
    assert {page.stem for page in pages} == set(FIGURES)
    assert {path.stem for path in FOLDER.glob("*.png")} == set(FIGURES)


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_is_small(name: str) -> None:
    assert (FOLDER / f"{name}.png").stat().st_size < LARGEST


def test_the_flow_of_the_verdict_ends_in_every_kind() -> None:
    ends = [
        kind_of(numerics=True),
        kind_of(imaging_limited=True),
        kind_of(),
        kind_of(left=True),
        kind_of(added=1),
        kind_of(added=1, rivals=1),
        kind_of(added=1, left=True, explained=LEAST_EXPLAINED),
    ]
    assert set(ends) == set(get_args(Kind)) and len(ends) == len(set(ends))
    assert kind_of(added=1, left=True, explained=LEAST_EXPLAINED - 0.01) == "unexplained"


def test_the_questions_of_the_flow_are_asked_in_its_order() -> None:
    assert kind_of(numerics=True, added=1, imaging_limited=True) == "numerics"
    assert kind_of(imaging_limited=True, left=True) == "imaging-limited"
    assert kind_of(imaging_limited=True, added=1) == "named"
    assert kind_of(added=3, rivals=1) == "unexplained"
    assert kind_of(added=1, rivals=1, left=True) == "named, but something is left"

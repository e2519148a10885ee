from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
import pytest

from driver.batch import summary
from driver.batch.progress import State
from driver.batch.summary import Answer, Estimate, comparison, summary_page, write_summary
from driver.case.model import write_case
from driver.results.files import DIAGNOSIS, RESULTS, TRUTH
from tests.driver.batch.cases import job
from tools.short_specimen import small_case


@pytest.fixture
def all_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """All stages are done for the cases as they are."""
    names = {"mesh", "measure", "identify", "diagnose", "advise", "report"}
    monkeypatch.setattr(summary, "stages_done", lambda path: frozenset(names))


def value(of: float, sigma: float, unit: str = "") -> dict[str, object]:
    return {"value": of, "sigma": sigma, "unit": unit}


def diagnosed(folder: Path, tau0: float, truth: float | None = None) -> State:
    """A case whose diagnosis named a contrast."""
    results = folder / RESULTS
    results.mkdir(parents=True)
    write_case(small_case(), folder / "case.toml")
    values = {
        "tau0": value(tau0, 0.5, "MPa"), "c": value(44000.0, 900.0, "MPa"),
        "d": value(1140.0, 30.0), "tau0_grain2": value(1.15, 0.01),
        "lambda_plus_Y": value(0.8, 0.01),
    }  # fmt: skip
    record = {
        "verdict": "named", "causes": ["grain_contrast"],
        "added": {"tau0_grain2": value(1.15, 0.01)},
        "extended": {"values": values}, "gain": {"budget_after": {"model": 1.01, "load": 0.98}},
    }  # fmt: skip
    (results / DIAGNOSIS).write_text(json.dumps(record))
    if truth is not None:
        known = {"values": {"tau0": {"value": truth, "unit": "MPa"}}}
        (folder / TRUTH).write_text(json.dumps(known))
    return State(job(folder, folder.name), "done", 10.0)


def table(folder: Path) -> list[dict[str, str]]:
    with (folder / "summary.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_the_table_has_the_final_model_of_each_case_and_why_others_have_none(
    tmp_path: Path, all_done: None
) -> None:
    one, two = (diagnosed(tmp_path / name, tau0, 25.0) for name, tau0 in (("a", 25.5), ("b", 24.0)))
    bad = job(tmp_path / "c", "c")
    write_summary(tmp_path, "mine", [one, two, State(bad, "failed", 1.0, words="c: found 1\nmore")])
    first, second, third = table(tmp_path)
    assert (first["case"], first["status"], first["verdict"]) == ("a", "done", "named")
    assert first["causes"] == "grain_contrast" and float(first["chi_images"]) == 1.01
    assert float(second["tau0 [MPa]"]) == 24.0 and float(second["sigma of tau0 [MPa]"]) == 0.5
    assert float(second["truth of tau0 [MPa]"]) == 25.0 and "truth of c [MPa]" not in second
    assert float(first["tau0_grain2"]) == 1.15 and "lambda_plus_Y" not in first
    assert third["why"] == "c: found 1 more" and third["tau0 [MPa]"] == ""


@pytest.mark.parametrize("text", ["{", "{}", '{"extended": 3}'])
def test_results_that_cannot_be_read_are_told_and_keep_no_other_case_out(
    tmp_path: Path, all_done: None, text: str
) -> None:
    good, broken = diagnosed(tmp_path / "a", 25.0), diagnosed(tmp_path / "b", 25.0)
    (tmp_path / "b" / RESULTS / DIAGNOSIS).write_text(text)
    write_summary(tmp_path, "mine", [good, broken])
    first, second = table(tmp_path)
    assert first["status"] == "done" and second["status"] == "failed"
    assert second["why"]


def test_results_of_another_state_or_of_stages_that_nobody_asked_for_are_none_of_this_campaign(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old = diagnosed(tmp_path / "a", 25.0)
    write_summary(tmp_path, "mine", [old])
    assert table(tmp_path)[0]["verdict"] == "" and table(tmp_path)[0]["status"] == "done"
    everything = frozenset({"mesh", "measure", "identify", "diagnose"})
    monkeypatch.setattr(summary, "stages_done", lambda path: everything)
    write_summary(tmp_path, "mine", [replace(old, job=replace(old.job, until="measure"))])
    assert table(tmp_path)[0]["verdict"] == ""
    write_summary(tmp_path, "mine", [old])
    assert table(tmp_path)[0]["verdict"] == "named"


def test_names_that_no_table_can_hold_end_nothing(tmp_path: Path) -> None:
    state = State(job(tmp_path, "\N{REPLACEMENT CHARACTER}"), "failed", 1.0, words="no")
    write_summary(tmp_path, "mine", [state])
    assert table(tmp_path)[0]["why"] == "no"


def test_the_page_names_every_case_and_escapes_what_it_is_called(tmp_path: Path) -> None:
    answers = [
        Answer("<b>1</b>", "done", "", 75.0, "../a b/results/report.html", "named",
               ("grain_contrast",), (1.0, 0.98), {"tau0": Estimate(25.0, 0.5, "MPa")}),
        Answer("two", "failed", "c.toml: found 1, expected 2", 0.0),
        Answer("three", "done", "", 5.0, estimates={"tau0": Estimate(24.0, 0.5, "MPa", 25.0)}),
    ]  # fmt: skip
    page = summary_page("mine", answers)
    assert "&lt;b&gt;1&lt;/b&gt;" in page and "<b>1" not in page
    assert 'href="../a%20b/results/report.html"' in page
    assert "3 cases: 1 named, 1 failed, 1 done." in page
    assert "c.toml: found 1, expected 2" in page and "25.0 ± 0.5 MPa" in page
    assert len(re.findall('class="truth"', page)) == 1
    # What is asked of a page: nothing from elsewhere.
    assert not re.findall(r'(?:src|href)="(?:https?:)?//', page)


def test_the_mean_is_weighted_and_the_scatter_is_that_of_the_cases_over_their_sigma() -> None:
    rng = np.random.default_rng(3)
    sigma = rng.uniform(0.5, 2.0, 400)
    drawn = 10.0 + sigma * rng.standard_normal(400)
    each = {
        str(k): Estimate(v, s, "", 10.0)
        for k, (v, s) in enumerate(zip(drawn.tolist(), sigma.tolist(), strict=True))
    }
    found = comparison("tau0", each)
    mean = float(found["mean"].partition(" ")[0])
    assert abs(mean - 10.0) < 4 * float(np.sum(sigma**-2) ** -0.5)
    assert float(found["scatter"]) == pytest.approx(1.0, abs=0.15)
    assert float(found["off"]) == pytest.approx(1.0, abs=0.15)
    apart = {k: Estimate(e.value + 20.0 * (int(k) % 2), e.sigma, "") for k, e in each.items()}
    assert float(comparison("tau0", apart)["scatter"]) > 5.0


@pytest.mark.parametrize(
    "each",
    [
        (Estimate(1.0, 0.0, ""), Estimate(1.0, 0.0, "", 1.0)),
        (Estimate(1.0, 0.0, ""), Estimate(2.0, 0.1, "")),
        (Estimate(1.0, float("nan"), "", 2.0), Estimate(2.0, float("inf"), "")),
        (Estimate(float("nan"), 0.1, ""), Estimate(2.0, 0.1, "")),
        (Estimate(1, 1, ""), Estimate(2, 1, "")),
    ],
)
def test_what_has_no_uncertainty_is_drawn_without_one_and_not_weighed(
    each: tuple[Estimate, Estimate],
) -> None:
    found = comparison("d", dict(zip("ab", each, strict=True)))
    drawn = [line["at"] for line in found["lines"] if line["at"] is not None]
    assert drawn and all(0.0 <= x <= found["width"] for x in drawn)
    good = [e for e in each if e.known]
    assert found["mean"].startswith("–") == (not good)
    assert (found["scatter"] == "–") == (len(good) < 2)
    answers = [
        Answer(name, "done", "", 0.0, estimates={"d": e})
        for name, e in zip("ab", each, strict=True)
    ]
    page = summary_page("mine", answers)
    places = re.findall(r'\s(?:x1|x2|cx|y1|y2|cy)="([^"]*)"', page)
    assert places and all(isfinite(float(place)) for place in places)


def test_the_picture_holds_all_intervals_and_truths() -> None:
    each = {"a": Estimate(1.0, 0.1, ""), "b": Estimate(2.0, 0.4, "", 3.5)}
    found = comparison("d", each)
    low, high = found["margin"], found["width"] - found["margin"]
    places = [line[key] for line in found["lines"] for key in ("from", "at", "to")]
    assert all(low <= place <= high for place in [*places, found["lines"][1]["truth"]])
    assert found["lines"][0]["from"] == low and found["lines"][1]["truth"] == high
    assert found["lines"][0]["truth"] is None and found["off"] == number_of(3.75)


def number_of(off: float) -> str:
    return f"{off:.1f}"

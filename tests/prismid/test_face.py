"""The Python face, used as docs/python.md says."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

import prismid

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
RUN, CORRELATION = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)


def test_every_name_that_is_offered_is_there_and_says_what_it_does() -> None:
    for name in prismid.__all__:
        assert getattr(prismid, name).__doc__


def test_the_example_of_a_run_goes_until_the_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    example = ROOT / "examples" / "alpha"
    shutil.copytree(example, tmp_path / "alpha", ignore=shutil.ignore_patterns("results"))
    monkeypatch.chdir(tmp_path)
    exec(RUN, {})
    told = capsys.readouterr().out
    assert "measure: started" in told and "measure: finished" in told
    assert (tmp_path / "alpha" / "results" / "measure.h5").is_file()


def test_the_example_of_a_correlation_finds_the_motion_that_it_made(
    capsys: pytest.CaptureFixture[str],
) -> None:
    exec(CORRELATION, {})
    assert re.fullmatch(r"0\.60 px, residual (0\.9|1\.0)\d of its noise\n", capsys.readouterr().out)

"""What tests of the driver share: lines of progress, and results of a finished case."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from driver.common.progress import progress_to
from driver.export import volume
from tests.driver.export.exported import Results


@pytest.fixture
def lines() -> Iterator[list[str]]:
    """All lines that the driver tells during a test."""
    told: list[str] = []
    with progress_to(told.append):
        yield told


@pytest.fixture
def willing(monkeypatch: pytest.MonkeyPatch) -> None:
    """A user who has agreed to whatever a case or a campaign asks for."""
    monkeypatch.setattr("driver.case.consent.is_agreed", lambda request: True)


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Results:
    made = Results(tmp_path / "alpha")
    monkeypatch.setattr(volume, "adapter_of", lambda case: made.solver)
    return made

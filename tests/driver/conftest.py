"""Results of a finished case, for the tests of what reads them."""

from pathlib import Path

import pytest

from driver.export import volume
from tests.driver.export.exported import Results


@pytest.fixture
def results(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Results:
    made = Results(tmp_path / "alpha")
    monkeypatch.setattr(volume, "adapter_of", lambda case: made.solver)
    return made

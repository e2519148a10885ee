"""Each subject has one script, which runs as a file and as a module, from any folder."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[2]
SUBJECTS = (
    "solver", "adapters", "numerics", "dic", "identification", "diagnosis", "scale", "people",
    "reliability",
)  # fmt: skip


@pytest.fixture(scope="module")
def installed_by_make() -> None:
    """Skip where `make` has not told the environment of this checkout."""
    told = Path(sysconfig.get_path("purelib"), "prismid_checkout.pth")
    if not told.exists() or Path(told.read_text("utf-8").strip()) != CHECKOUT:
        pytest.skip(f"{told} does not name {CHECKOUT}: `make kernels` writes it")


@pytest.mark.usefixtures("installed_by_make")
@pytest.mark.parametrize("subject", SUBJECTS)
def test_the_script_of_a_subject_starts_from_any_folder(subject: str, tmp_path: Path) -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [sys.executable, str(CHECKOUT / "benchmarks" / f"{subject}.py"), "--help"]
    answer = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    assert "--quick" in answer.stdout


def test_no_script_has_the_name_of_a_module_that_others_import() -> None:
    """Run as a file, a script has its folder before all others: Numba imports `coverage`."""
    scripts = {path.stem for path in (CHECKOUT / "benchmarks").glob("*.py")}
    assert not scripts & (sys.stdlib_module_names | {"coverage"})

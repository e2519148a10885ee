"""The worked example of the documentation is a package that installs and runs as it stands."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "solver-adapters.md").read_text(encoding="utf-8")

# Run in a process of its own: the entry point of the installed package is all that leads to it.
USE = """
import json, sys
import numpy as np
from dataclasses import replace
from pathlib import Path
from solver_adapters.external import Profile
from solver_adapters.interface import UnsupportedError
from solver_adapters.material import Material
from solver_adapters.registry import adapter_names, find_adapter
from tools.boxes import box, pulled

adapter = find_adapter("bar", Profile(command=(sys.executable,)))
small = Material(strain_measure="small")
simulation = replace(pulled(box(), small, (1e-4,)), integration="backward_euler",
                     orientations=np.stack([np.eye(3)] * 2))
response = adapter.solve(simulation, Path("jobs"))
try:
    adapter.solve(replace(simulation, material=replace(small, Q=5.0)))
    refused = ""
except UnsupportedError as error:
    refused = str(error)
print(json.dumps({"names": adapter_names(), "force": response.force.tolist(),
                  "motion": response.displacement.max(), "refused": refused}))
"""


def example() -> dict[str, str]:
    """The files of the worked example by name."""
    return dict(re.findall(r"^`([\w.]+)`:\n\n```\w+\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL))


def test_the_worked_example_is_short() -> None:
    files = example()
    assert set(files) == {"pyproject.toml", "prismid_bar.py"}
    assert sum(text.count("\n") for text in files.values()) < 80


@pytest.mark.slow  # builds a package as pip does, with setuptools from the registry
def test_the_worked_example_is_installed_as_a_package_and_solves(tmp_path: Path) -> None:
    source, target = tmp_path / "source", tmp_path / "installed"
    source.mkdir()
    for name, text in example().items():
        (source / name).write_text(text, encoding="utf-8")
    pip = [sys.executable, "-m", "pip"]
    install = [*pip, "install", "--no-deps", "--target", str(target), str(source)]
    subprocess.run(install, check=True, capture_output=True)
    path = os.pathsep.join([str(target), str(ROOT)])
    used = subprocess.run(
        [sys.executable, "-c", USE], cwd=tmp_path, env={**os.environ, "PYTHONPATH": path},
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    found = json.loads(used.stdout)
    assert {"bar", "bundled"} <= set(found["names"])
    # Along ⟨100⟩ Young's modulus is C11 − 2 C12²/(C11 + C12); 2 × 2 µm², strain 1e-4.
    modulus = 233.5e3 - 2 * 135.5e3**2 / (233.5e3 + 135.5e3)
    np.testing.assert_allclose(found["force"], [0.0, modulus * 4.0 * 1e-4], rtol=1e-9)
    assert found["motion"] == pytest.approx(4e-4)
    assert found["refused"].startswith("Q = 5: the solver bar cannot honour it;")
    assert "bundled" in found["refused"]

"""OpenBLAS below CHOLMOD is told what the processor can do, and nobody else is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cvxopt
import pytest

from solver_adapters.cholmod import CORE, PROCESSOR, core_told, has_avx2

AVX2 = "processor\t: 0\nflags\t\t: fpu sse3 fma avx avx2 avx512f\n\nprocessor\t: 1\n"
CORE_NAME = """
import ctypes, sys
import solver_adapters.cholmod
library = ctypes.CDLL(sys.argv[1])
library.openblas_get_corename.restype = ctypes.c_char_p
print(library.openblas_get_corename().decode())
"""


def _file(folder: Path, text: str) -> Path:
    path = folder / "cpuinfo"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_processor_has_avx2_where_linux_says_so(tmp_path: Path) -> None:
    assert has_avx2(_file(tmp_path, AVX2))
    for text in (AVX2.replace("avx2 ", ""), AVX2.replace("fma ", ""), "Features\t: neon\n", ""):
        assert not has_avx2(_file(tmp_path, text))
    assert not has_avx2(tmp_path / "none")


def test_the_environment_is_as_before_once_the_library_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(CORE, raising=False)
    with core_told(_file(tmp_path, AVX2)):
        assert os.environ[CORE] == "Haswell"
    assert CORE not in os.environ
    with core_told(tmp_path / "none"):
        assert CORE not in os.environ


def test_what_the_user_told_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORE, "Zen")
    with core_told(_file(tmp_path, AVX2)):
        assert os.environ[CORE] == "Zen"
    assert os.environ[CORE] == "Zen"


def test_on_a_processor_with_avx2_openblas_of_the_wheel_uses_it() -> None:
    libraries = Path(cvxopt.__file__).parent.with_name("cvxopt.libs")
    found = sorted(libraries.glob("libopenblas*.so"))
    if not found or not has_avx2(PROCESSOR):
        pytest.skip("no OpenBLAS in a wheel of cvxopt, or no AVX2")
    environment = {name: value for name, value in os.environ.items() if name != CORE}
    told = subprocess.run(
        [sys.executable, "-c", CORE_NAME, str(found[0])],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    assert told.stdout.strip() == "Haswell"

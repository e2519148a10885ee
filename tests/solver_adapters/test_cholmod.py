"""OpenBLAS below CHOLMOD is told what the processor can do, and nobody else is."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import cvxopt
import pytest

from solver_adapters.cholmod import CORE, PROCESSOR, core_of, core_type_set

AVX2 = (
    "processor\t: 0\nvmx flags\t: ept\nflags\t\t: fpu sse3 fma avx avx2 avx512f\n\nprocessor\t: 1\n"
)
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


def test_a_processor_is_told_as_one_of_the_same_vectors(tmp_path: Path) -> None:
    assert core_of(_file(tmp_path, AVX2)) == "Haswell"
    wide = AVX2.replace("avx512f", "avx512f avx512cd avx512bw avx512dq avx512vl")
    assert core_of(_file(tmp_path, wide)) == "SkylakeX"
    for text in (AVX2.replace("avx2 ", ""), AVX2.replace("fma ", ""), "Features\t: neon\n", ""):
        assert core_of(_file(tmp_path, text)) is None
    assert core_of(tmp_path / "none") is None


def test_the_name_of_a_processor_may_be_in_any_encoding(tmp_path: Path) -> None:
    path = tmp_path / "cpuinfo"
    path.write_bytes(b"model name\t: Intel\xae\n" + AVX2.encode())
    assert core_of(path) == "Haswell"


def test_the_environment_is_as_before_once_the_library_is_loaded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(CORE, raising=False)
    with core_type_set(_file(tmp_path, AVX2)):
        assert os.environ[CORE] == "Haswell"
    assert CORE not in os.environ
    with suppress(ImportError), core_type_set(_file(tmp_path, AVX2)):
        raise ImportError
    assert CORE not in os.environ
    with core_type_set(tmp_path / "none"):
        assert CORE not in os.environ


def test_what_the_user_told_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(CORE, "Zen")
    with core_type_set(_file(tmp_path, AVX2)):
        assert os.environ[CORE] == "Zen"
    assert os.environ[CORE] == "Zen"


def test_openblas_of_the_wheel_uses_what_it_is_told() -> None:
    libraries = Path(cvxopt.__file__).parent.with_name("cvxopt.libs")
    found = sorted(libraries.glob("libopenblas*.so"))
    core = core_of(PROCESSOR)
    if not found or core is None:
        pytest.skip("no OpenBLAS in a wheel of cvxopt, or no AVX2")
    environment = {name: value for name, value in os.environ.items() if name != CORE}
    told = subprocess.run(
        [sys.executable, "-c", CORE_NAME, str(found[0])],
        capture_output=True, text=True, check=True, env=environment,
    )  # fmt: skip
    assert told.stdout.strip() == core

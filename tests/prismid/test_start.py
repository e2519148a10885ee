"""How the program begins: whatever the folder of the call, the user and his locale are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LIBRARIES = os.pathsep.join((str(ROOT), *filter(None, (os.environ.get("PYTHONPATH"),))))


def called(folder: Path, *words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    given = os.environ | {"PYTHONPATH": LIBRARIES} | environment
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=given, capture_output=True, text=True,
        encoding="utf-8", check=False,
    )  # fmt: skip


def test_files_of_the_folder_of_the_call_are_not_imported(tmp_path: Path) -> None:
    for name in ("driver", "meshes", "numpy", "solver_adapters", "typer"):
        (tmp_path / f"{name}.py").write_text(f"raise SystemExit('{name} of the folder')")
    (tmp_path / "templates").mkdir()
    (tmp_path / "templates" / "__init__.py").write_text("raise SystemExit('templates')")
    found = called(tmp_path, "-m", "prismid", "init", "new")
    assert (found.returncode, found.stderr) == (0, "")
    assert (tmp_path / "new" / "case.toml").is_file()


def test_settings_of_matplotlib_in_the_folder_of_the_call_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "matplotlibrc").write_text("font.size: 40\nno.such.key: 1\n")
    code = "import driver.check, matplotlib; print(matplotlib.rcParams['font.size'])"
    found = called(tmp_path, "-P", "-c", code)
    assert (found.stdout, found.stderr) == ("10.0\n", "")


@pytest.mark.parametrize("home", [None, "/proc/none"])
def test_a_user_without_a_home_makes_a_case(tmp_path: Path, home: str | None) -> None:
    environment = {"TMPDIR": str(tmp_path), "XDG_CACHE_HOME": "", "XDG_CONFIG_HOME": ""}
    code = "import os, pwd; pwd.getpwuid = lambda uid: {}[uid]\n"
    if home is None:
        code += "del os.environ['HOME']\n"
    else:
        environment["HOME"] = home
    code += "from prismid.__main__ import main; main()"
    found = called(tmp_path, "-c", code, "init", "new", **environment)
    assert (found.returncode, found.stderr) == (0, "")


def test_a_second_ctrl_c_as_python_ends_shows_no_traceback(tmp_path: Path) -> None:
    code = (
        "import atexit, os, signal\n"
        "atexit.register(lambda: os.kill(os.getpid(), signal.SIGINT))\n"
        "from prismid.__main__ import main; main()"
    )
    found = called(tmp_path, "-c", code, "--version")
    assert (found.returncode, found.stderr) == (0, "")


def test_a_terminal_without_our_signs_gets_others_in_their_place(tmp_path: Path) -> None:
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    found = called(tmp_path, "-m", "prismid", "init", "für σ", **environment)
    assert (found.returncode, found.stderr) == (0, "")
    assert found.stdout.isascii()
    assert (tmp_path / "für σ" / "case.toml").is_file()


def test_a_prism_is_meshed_in_a_folder_with_an_umlaut_whatever_the_locale(tmp_path: Path) -> None:
    environment = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"}
    code = (
        "import medcoupling, sys; from pathlib import Path; from meshes import med_file\n"
        "grid = medcoupling.MEDCouplingUMesh('m', 3)\n"
        "grid.setCoords(medcoupling.DataArrayDouble([0.,0,0,1,0,0,0,1,0,0,0,1],4,3))\n"
        "grid.allocateCells(1); grid.insertNextCell(medcoupling.NORM_TETRA4, [0,1,2,3])\n"
        "file = medcoupling.MEDFileUMesh(); file[0] = grid\n"
        "med_file.write_as_med_4_0(file, Path(sys.argv[1]), True)\n"
        "print(med_file.open_med(Path(sys.argv[1])).mesh.getNumberOfNodes())"
    )
    found = called(tmp_path, "-P", "-c", code, "Prüfling.med", **environment)
    assert (found.stdout, found.stderr) == ("4\n", "")
    assert (tmp_path / "Prüfling.med").is_file()

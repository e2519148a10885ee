from __future__ import annotations

import ast
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from meshes import system_libraries
from meshes.gmsh_library import load_gmsh
from meshes.system_libraries import (
    ADMINISTRATOR_COMMAND,
    PACKAGES,
    SystemLibraryError,
    missing_libraries,
    preload,
    private_folder,
    provide,
)

SCRIPT = Path(system_libraries.__file__)
C_LIBRARY = {"libc.so", "libm.so", "libdl.so", "librt.so", "libpthread.so"}
linux_only = pytest.mark.skipif(sys.platform != "linux", reason="the other wheels bring their own")


def needed_by(path: str, folder: Path) -> dict[str, str]:
    """Name and place of each library that the loader maps for the file at `path`."""
    listing = subprocess.run(
        ["ldd", path], capture_output=True, text=True, env={"LD_LIBRARY_PATH": str(folder)}
    ).stdout
    pairs = (line.split() for line in listing.splitlines() if "=>" in line)
    return {words[0]: words[2] for words in pairs}


@linux_only
def test_every_library_that_gmsh_maps_has_its_package_and_stands_after_what_it_needs() -> None:
    gmsh = load_gmsh()
    mapped = needed_by(gmsh.libpath, private_folder())
    ours = {name: at for name, at in mapped.items() if name.rpartition(".")[0] not in C_LIBRARY}
    assert set(ours) == set(PACKAGES)
    order = list(PACKAGES)
    for name, at in ours.items():
        for needed in set(needed_by(at, private_folder())) & set(PACKAGES):
            assert order.index(needed) < order.index(name)


@linux_only
def test_without_apt_the_missing_libraries_and_the_administrators_command_are_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(PACKAGES, "libprismid-absent.so.7", ("libprismid-absent7",))
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(SystemLibraryError) as caught:
        provide(tmp_path)
    assert "library libprismid-absent.so.7," in str(caught.value)
    assert ADMINISTRATOR_COMMAND in str(caught.value)


def renamed_library(name: str) -> bytes:
    """The smallest library of the installed wheels, which calls itself by another name."""
    bundled = Path(sysconfig.get_paths()["platlib"]).glob("*.libs/*.so*")
    smallest = min((p for p in bundled if len(p.name) >= len(name)), key=lambda p: p.stat().st_size)
    own, image = smallest.name.encode(), smallest.read_bytes()
    assert image.count(own) == 1
    return image.replace(own, name.encode().ljust(len(own), b"\0"))


@linux_only
def test_a_library_unpacked_without_root_is_found_by_its_name(tmp_path: Path) -> None:
    name = "libprismid-private.so.1"
    (tmp_path / name).write_bytes(renamed_library(name))
    PACKAGES[name] = ("libprismid-private1",)
    try:
        assert name in missing_libraries()
        preload(tmp_path)
        assert name not in missing_libraries()
    finally:
        del PACKAGES[name]


def test_the_set_up_script_imports_the_standard_library_only() -> None:
    tree = ast.parse(SCRIPT.read_text(encoding="utf-8"))
    imported = {
        name.split(".")[0]
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    assert "ctypes" in imported
    assert imported <= sys.stdlib_module_names


def test_the_set_up_script_is_silent_where_nothing_is_missing() -> None:
    finished = subprocess.run([sys.executable, "-I", SCRIPT], capture_output=True, text=True)
    assert (finished.returncode, finished.stdout, finished.stderr) == (0, "", "")

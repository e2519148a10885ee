from __future__ import annotations

import os
import signal
import subprocess
import sys

import pytest

from meshes.gmsh_library import load_gmsh, running_gmsh
from meshes.system_libraries import SystemLibraryError
from solver_adapters.kernels import PACKAGES
from tests.support.waiting import hears_as_it_waits


def test_gmsh_meshes() -> None:
    with running_gmsh() as gmsh:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.model.occ.addBox(0.0, 0.0, 0.0, 1.0, 1.0, 1.0)
        gmsh.model.occ.synchronize()
        gmsh.model.mesh.generate(3)
        assert gmsh.model.mesh.getNodes()[0].size >= 8


def test_a_library_that_gmsh_lacks_is_named_with_the_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(_: str) -> None:
        raise OSError("libGLU.so.1: cannot open shared object file: No such file or directory")

    monkeypatch.setattr("meshes.gmsh_library.importlib.import_module", fail)
    with pytest.raises(SystemLibraryError, match=r"library libGLU\.so\.1, .*apt-get install"):
        load_gmsh()


MESH_AND_WRITE = """
import os
import signal
from meshes.gmsh_library import running_gmsh

signal.signal(signal.SIGHUP, signal.SIG_IGN)
signal.signal(signal.SIGTERM, lambda *_: print("asked to end"))
with running_gmsh():
    reader, writer = os.pipe()
    os.close(reader)
    try:
        os.write(writer, b"to nobody")
    except BrokenPipeError:
        print("inside")
try:
    os.write(writer, b"to nobody")
except BrokenPipeError:
    print("after")
signal.raise_signal(signal.SIGHUP)
signal.raise_signal(signal.SIGTERM)
try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_a_process_that_has_meshed_heeds_and_ignores_signals_as_before() -> None:
    """A process of its own: only the first session of a process touches its signals."""
    ended = subprocess.run(
        [sys.executable, "-c", MESH_AND_WRITE],
        env={**os.environ, "PYTHONPATH": str(PACKAGES)},
        capture_output=True,
        text=True,
        preexec_fn=heard,
    )
    assert (ended.returncode, ended.stdout) == (0, "inside\nafter\nasked to end\ninterrupted\n")


MESH = """
from meshes.gmsh_library import running_gmsh

with running_gmsh():
    pass
"""


def test_a_process_that_has_meshed_hears_of_a_signal_as_it_waits_for_others() -> None:
    """As a run does whose processes are at work: SIGTERM came to nothing until one had ended."""
    assert hears_as_it_waits(MESH, "SIGTERM")


def heard() -> None:
    """What runs in the background of a shell ignores Ctrl-C unless it says otherwise."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)

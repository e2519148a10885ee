"""The system libraries that the gmsh wheel links against: found, installed or unpacked.

Run by path (``python -I meshes/system_libraries.py``) it needs the standard library only, so that
the set-up works before anything is installed.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

# Debian and Ubuntu package names of each shared library, in an order in which every library comes
# after the ones it needs: preloading in this order resolves a library by the name it is known by.
# Where two names are given, the second one is that of releases since the 64-bit time transition.
PACKAGES: dict[str, tuple[str, ...]] = {
    "libz.so.1": ("zlib1g",),
    "libgcc_s.so.1": ("libgcc-s1",),
    "libstdc++.so.6": ("libstdc++6",),
    "libgomp.so.1": ("libgomp1",),
    "libmd.so.0": ("libmd0",),
    "libbsd.so.0": ("libbsd0",),
    "libXau.so.6": ("libxau6",),
    "libXdmcp.so.6": ("libxdmcp6",),
    "libxcb.so.1": ("libxcb1",),
    "libX11.so.6": ("libx11-6",),
    "libXext.so.6": ("libxext6",),
    "libXrender.so.1": ("libxrender1",),
    "libXfixes.so.3": ("libxfixes3",),
    "libXcursor.so.1": ("libxcursor1",),
    "libXinerama.so.1": ("libxinerama1",),
    "libexpat.so.1": ("libexpat1",),
    "libbrotlicommon.so.1": ("libbrotli1",),
    "libbrotlidec.so.1": ("libbrotli1",),
    "libpng16.so.16": ("libpng16-16", "libpng16-16t64"),
    "libfreetype.so.6": ("libfreetype6",),
    "libfontconfig.so.1": ("libfontconfig1",),
    "libXft.so.2": ("libxft2",),
    "libGLdispatch.so.0": ("libglvnd0",),
    "libGLX.so.0": ("libglx0",),
    "libGL.so.1": ("libgl1",),
    "libOpenGL.so.0": ("libopengl0",),
    "libGLU.so.1": ("libglu1-mesa",),
}

# What an administrator types: the packages that pull in all the others.
ADMINISTRATOR_COMMAND = (
    "apt-get install -y --no-install-recommends "
    "libglu1-mesa libgl1 libxcursor1 libxinerama1 libxft2 libgomp1"
)


class SystemLibraryError(ImportError):
    """A system library that gmsh needs is missing and could not be provided."""

    def __init__(self, names: Sequence[str], reason: str = "") -> None:
        """Say in one sentence which libraries are missing and what remedies it."""
        because = f" ({reason})" if reason else ""
        super().__init__(
            f"gmsh needs the system {'library' if len(names) == 1 else 'libraries'} "
            f"{', '.join(names)}, found none of that name{because}: "
            f"ask an administrator to run `{ADMINISTRATOR_COMMAND}`."
        )


def private_folder() -> Path:
    """Folder of the virtual environment that holds the libraries unpacked without root."""
    return Path(sys.prefix) / "lib" / "system"


def preload(folder: Path) -> None:
    """Load the libraries unpacked in `folder`, so that gmsh finds them by name."""
    for name in PACKAGES:
        if (folder / name).exists():
            ctypes.CDLL(str(folder / name), mode=ctypes.RTLD_GLOBAL)


def missing_libraries() -> tuple[str, ...]:
    """Names of the libraries, in loading order, that this process cannot load."""
    return tuple(name for name in PACKAGES if not _loads(name))


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def provide(folder: Path) -> None:
    """Install the missing libraries as root through apt, otherwise unpack them into `folder`.

    Nothing is done, and no other program is started, when every library loads. The gmsh wheels of
    other systems than Linux bring what they need.

    Raises:
        SystemLibraryError: libraries are missing still, because there is no apt or it failed.
    """
    if not sys.platform.startswith("linux"):
        return
    preload(folder)
    missing = missing_libraries()
    if not missing:
        return
    if shutil.which("apt-get") is None or shutil.which("dpkg-deb") is None:
        raise SystemLibraryError(missing, "this system has no apt to fetch them with")
    if os.geteuid() == 0:
        print(f"Installing the system libraries of gmsh with apt: {', '.join(missing)}")
        _install()
    else:
        print(f"Unpacking the system libraries of gmsh into {folder}: {', '.join(missing)}")
        _unpack(missing, folder)
    preload(folder)
    if still_missing := missing_libraries():
        raise SystemLibraryError(still_missing, "apt did not provide them")


def _install() -> None:
    _apt("apt-get", "update")
    environment = os.environ | {"DEBIAN_FRONTEND": "noninteractive"}
    _apt(*ADMINISTRATOR_COMMAND.split(), environment=environment)


def _unpack(missing: Sequence[str], folder: Path) -> None:
    """Fetch the packages of the missing libraries and copy the libraries into `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(temporary)
        # apt writes its lists and its cache where this user may: root's are neither read nor kept.
        for part in ("lists/partial", "cache/archives/partial", "unpacked"):
            (work / part).mkdir(parents=True)
        options = (
            *("-o", f"Dir::State::lists={work}/lists", "-o", f"Dir::Cache={work}/cache"),
            *("-o", "Debug::NoLocking=1"),
        )
        _apt("apt-get", *options, "update")
        for names in {PACKAGES[library] for library in missing}:
            # Of two names of one package, a release knows one.
            any(_apt("apt-get", *options, "download", name, folder=work) for name in names)
        for package in work.glob("*.deb"):
            _apt("dpkg-deb", "-x", str(package), str(work / "unpacked"))
        for library in missing:
            for path in (work / "unpacked").rglob(library):
                shutil.copyfile(path, folder / library)  # follows the link to the versioned file


def _apt(
    *command: str, folder: Path | None = None, environment: dict[str, str] | None = None
) -> bool:
    """Run a command silently; what it achieved is judged by the libraries that load afterwards."""
    finished = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, stdin=subprocess.DEVNULL
    )
    return finished.returncode == 0


if __name__ == "__main__":
    try:
        provide(private_folder())
    except SystemLibraryError as error:
        sys.exit(f"prismid set-up: {error}")

"""The PBS of one node that this machine may have: what it holds, and why it is none for tests.

Debian has no package of OpenPBS.
"""

from __future__ import annotations

import json
import os
import shutil
import socket
import subprocess
from typing import Any

PROGRAMS = ("qsub", "qdel", "qselect", "qstat", "pbsnodes")


def unusable() -> str:
    """Return why it cannot be used, nothing where it can."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return f"no {', '.join(missing)} here: OpenPBS"
    if os.geteuid() == 0:
        return "jobs of root, whose processes OpenPBS neither counts nor ends: run as another user"
    asked = subprocess.run(["pbsnodes", "-a", "-F", "json"], capture_output=True, text=True)
    if asked.returncode:
        return f"no PBS answers here: {asked.stderr.strip()}"
    nodes = {node["Mom"].partition(".")[0] for node in json.loads(asked.stdout)["nodes"].values()}
    # Tests look at the processes of its jobs.
    this = socket.gethostname().partition(".")[0]
    return "" if nodes == {this} else f"the PBS here has other nodes than {this}"


def queued() -> list[str]:
    """Return the jobs that have not ended, by their identifiers."""
    return _answer("qselect").splitlines()


def asked_of(job: str) -> dict[str, Any]:
    """Return what PBS knows of a job."""
    jobs = json.loads(_answer("qstat", "-f", "-F", "json", job))["Jobs"]
    (known,) = jobs.values()
    return dict(known)


def _answer(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout

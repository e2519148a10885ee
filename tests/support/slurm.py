"""A Slurm of one node or more on this machine, with a key, sockets, ports and a folder of its own.

    python -m tests.support.slurm COMMAND…    run a command that finds it, as `sinfo` or `bash`

It needs the Debian packages slurm-wlm and munge, and no rights but those of its user. Processes of
a job are found by their process group, without control groups, so that it runs in a container.
"""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from getpass import getuser
from pathlib import Path
from tempfile import TemporaryDirectory

PROGRAMS = ("munge", "munged", "slurmctld", "slurmd", "sbatch", "squeue", "scancel")
_FULL_PATH = os.pathsep.join((os.environ.get("PATH", os.defpath), "/usr/sbin", "/sbin"))
_PATIENCE = 30.0  # s, for the start of a service, and for the end of jobs that are cancelled

_CONF = """\
ClusterName=prismid
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={port}
SlurmdTimeout={silence}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
CredType=cred/munge
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool.%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.%n.pid
MailProg=/bin/true
ProctrackType=proctrack/pgid
TaskPlugin=task/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU_Memory
SlurmdParameters=config_overrides
SchedulerParameters=batch_sched_delay=0
KillWait=5
PartitionName={partition} Nodes=ALL Default=YES State=UP
"""
_NODE = (
    "NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={cores} "
    "RealMemory={memory} State=UNKNOWN\n"
)
PARTITION = "main"


def missing() -> list[str]:
    """Return the programs that it needs and that are not on this machine."""
    return [name for name in PROGRAMS if shutil.which(name, path=_FULL_PATH) is None]


@contextmanager
def slurm(
    cores: int = 2, memory: int = 8000, nodes: int = 1, silence: int = 300
) -> Iterator[Mapping[str, str]]:
    """Start it, and end it with all its jobs.

    Args:
        cores: of a node, which may be more than there are.
        memory: of a node, nor is it limited [MB].
        nodes: node1, node2 and so on, each with a daemon of its own.
        silence: after which a node that does not answer is lost [s].

    Yields:
        Variables of the environment by which commands of Slurm find it.

    Raises:
        RuntimeError: a service did not start.
    """
    # Not where pytest has its folders: the path of a socket has 108 characters at most.
    with TemporaryDirectory(prefix="slurm-") as name, ExitStack() as services:
        folder = Path(name)
        folder.chmod(0o755)  # as munge demands
        (folder / "state").mkdir()
        (folder / "munge.key").touch(mode=0o600)
        (folder / "munge.key").write_bytes(os.urandom(1024))
        host = socket.gethostname().partition(".")[0]
        names = [f"node{place}" for place in range(1, nodes + 1)]
        port, *ports = _free_ports(1 + nodes)
        told = [
            _NODE.format(name=name, host=host, port=own, cores=cores, memory=memory)
            for name, own in zip(names, ports, strict=True)
        ]
        conf = folder / "slurm.conf"
        conf.write_text(
            "".join(told)
            + _CONF.format(
                host=host, port=port, user=getuser(), folder=folder, partition=PARTITION,
                silence=silence,
            )
        )  # fmt: skip
        found = {"SLURM_CONF": str(conf), "PATH": _FULL_PATH}
        of_munge = {"key-file": "key", "socket": "socket", "pid-file": "pid", "log-file": "log",
                    "seed-file": "seed"}  # fmt: skip
        options = [f"--{option}={folder}/munge.{end}" for option, end in of_munge.items()]
        services.enter_context(
            _service("munged", ["munged", "--foreground", *options], folder, found)
        )
        _wait_for(f"munge --no-input --socket={folder}/munge.socket --output=/dev/null", "",
                  found, folder)  # fmt: skip
        services.enter_context(_service("slurmctld", ["slurmctld", "-D"], folder, found))
        for name in names:
            services.enter_context(_service(name, ["slurmd", "-D", "-N", name], folder, found))
        _wait_for("sinfo --noheader --format=%T", "idle", found, folder)
        try:
            yield found
        finally:
            _answer(f"scancel --user={getuser()}", found)
            _wait_for("squeue --noheader", "", found, folder)


@contextmanager
def _service(
    name: str, command: list[str], folder: Path, found: Mapping[str, str]
) -> Iterator[None]:
    """Keep a service running that writes into a log of its name."""
    with (folder / f"{name}.log").open("wb") as log:
        process = subprocess.Popen(command, env=os.environ | found, stdout=log, stderr=log)
    try:
        yield
    finally:
        process.terminate()  # No error where it has ended.
        process.wait(timeout=_PATIENCE)


def _answer(command: str, found: Mapping[str, str]) -> str | None:
    """Return what a command answers, None where it fails."""
    ended = subprocess.run(command.split(), env=os.environ | found, capture_output=True, text=True)
    return None if ended.returncode else ended.stdout.strip()


def _wait_for(command: str, answer: str, found: Mapping[str, str], folder: Path) -> None:
    late = time.monotonic() + _PATIENCE
    while _answer(command, found) != answer:
        if time.monotonic() > late:
            logs = "\n".join(log.read_text("utf-8") for log in sorted(folder.glob("*.log")))
            raise RuntimeError(f"`{command}` does not answer “{answer}”:\n{logs}")
        time.sleep(0.1)


def _free_ports(number: int) -> list[int]:
    with ExitStack() as open_ones:
        sockets = [open_ones.enter_context(socket.socket()) for _ in range(number)]
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]


def main() -> int:
    """Run a command beside it, and return its exit code."""
    with slurm() as found:
        return subprocess.run(sys.argv[1:], env=os.environ | found).returncode


if __name__ == "__main__":
    sys.exit(main())

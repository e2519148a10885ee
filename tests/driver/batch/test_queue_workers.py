"""What queue systems are asked for; test_slurm.py and test_pbs.py, beside this, ask real ones."""

from __future__ import annotations

import re
import signal
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Literal

import pytest

from driver.batch import queue_workers
from driver.batch.command import batch
from driver.batch.queue_workers import cluster_of, of_job, refuse_unusable
from driver.batch.queues import Queue
from driver.common.errors import InputError
from tests.driver.batch.cases import write_small_case
from tests.driver.batch.queue_commands import asked_of

SCRIPTS = {
    "slurm": [
        "#SBATCH -p short", "#SBATCH -A steel", "#SBATCH --cpus-per-task=4", "#SBATCH --mem=3G",
        "#SBATCH -t 01:02:03", "#SBATCH --qos=x",
    ],
    "pbs": [
        "#PBS -q short", "#PBS -A steel", "#PBS -l select=1:ncpus=4:mem=2385MB",
        "#PBS -l walltime=01:02:03", "#PBS --qos=x",
    ],
    "lsf": [
        "#BSUB -q short", '#BSUB -P "steel"', "#BSUB -n 4", '#BSUB -R "span[hosts=1]"',
        "#BSUB -M 2500000", "#BSUB -W 01:03", "#BSUB --qos=x",
    ],
}  # fmt: skip


# Not by `importorskip`: the import of the library sets what Ctrl-C does.
of_extra = pytest.mark.skipif(
    find_spec("dask_jobqueue") is None, reason="dask-jobqueue is of the extra cluster"
)


@of_extra
@pytest.mark.parametrize("system", ["slurm", "pbs", "lsf"])
def test_the_script_of_a_job_says_what_the_campaign_does(
    tmp_path: Path, system: Literal["slurm", "pbs", "lsf"]
) -> None:
    queue = Queue(
        system=system, queue="short", account="steel", walltime="01:02:03",
        job_extra_directives=("--qos=x",), job_script_prologue=("module load calculix",),
    )  # fmt: skip
    kind, asked = cluster_of(queue).job_cls, of_job(queue, 4, 2e9, tmp_path)
    script = kind("tcp://host:1", name="one", **asked).job_script().splitlines()
    assert set(SCRIPTS[system]) < set(script)
    *_, before, worker = script
    assert before == "module load calculix"
    assert worker.startswith(f"{sys.executable} -m distributed.cli.dask_worker tcp://host:1 ")
    # One case at a time, whatever the cores; the last of two options holds.
    assert "--no-nanny" in worker and re.findall(r"--nthreads (\d+)", worker)[-1] == "1"


def test_the_memory_of_a_job_is_that_which_is_stated(tmp_path: Path) -> None:
    queue = Queue(system="slurm", walltime="00:01:00", memory_GB=8.0)
    assert of_job(queue, 1, 2e9, tmp_path)["memory"] == "8000000000B"


@of_extra
def test_to_ask_for_workers_does_not_change_what_ctrl_c_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    for name in [name for name in sys.modules if name.startswith("dask_jobqueue")]:
        monkeypatch.delitem(sys.modules, name)  # the library sets it as it is imported
    before = signal.getsignal(signal.SIGINT)
    cluster_of(Queue(system="slurm", walltime="00:01:00"))
    assert signal.getsignal(signal.SIGINT) is before


def test_what_is_not_on_this_machine_is_told_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(queue_workers, "find_spec", lambda name: None)
    queue = Queue(system="pbs", walltime="00:01:00", interface="nowhere0")
    file = tmp_path / "two words.toml"
    with pytest.raises(InputError) as error:
        refuse_unusable(queue, file)
    told = str(error.value).splitlines()
    assert all(line.startswith(f"{file}: cluster") for line in told)
    places = [line.removeprefix(f"{file}: ") for line in told]
    assert places[0] == (
        "cluster: found a table without the library dask_jobqueue and cryptography, expected `pip "
        'install "prismid[cluster]"` before'
    )
    assert places[1].startswith('cluster.system: found "pbs" without its command qsub, expected a')
    assert places[2].startswith('cluster.system: found "pbs" without its command qdel, expected a')
    assert places[3].startswith('cluster.interface: found "nowhere0", expected a network of this')
    assert places[4].startswith(f"cluster: found the path {tmp_path}/two words.batch, expected one")


def test_a_campaign_with_a_bad_case_and_no_queue_system_is_told_both_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    write_small_case(tmp_path / "good")
    file = tmp_path / "campaign.toml"
    file.write_text(
        '[[study]]\ncase = "good/case.toml"\nvalues."specimen.length_um" = [-1.0]\n'
        '[cluster]\nsystem = "slurm"\nwalltime = "00:10:00"\n'
    )
    with pytest.raises(InputError) as error:
        batch(file, lambda states, at_a_time: None)
    lines = str(error.value).splitlines()
    assert "specimen.length_um: found -1.0" in lines[0] and "its command sbatch" in lines[1]
    assert not file.with_suffix(".batch").exists()


def test_why_all_jobs_wait_is_told_once_and_again_when_it_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    monkeypatch.setattr(queue_workers, "_PATIENT", 0.0)
    answer = asked_of(tmp_path, monkeypatch, "squeue", "--noheader --format=%T|%r --jobs=7")
    logs = tmp_path / "workers"
    logs.mkdir()
    cluster = SimpleNamespace(
        scheduler=SimpleNamespace(workers={}), workers={"one": SimpleNamespace(job_id="7")}
    )
    look = queue_workers._refuse_none(cluster, [], logs, tmp_path / "campaign.toml", "slurm")
    for why in ("Resources", "Resources", "node 3", "node 4"):
        answer.write_text(f"PENDING|{why}\n", encoding="utf-8")
        look()
    told = [f"all jobs of slurm wait: 1 × “{why}”" for why in ("Resources", "node 3")]
    assert caplog.messages == told
    (logs / "slurm-7.out").touch()
    answer.write_text("PENDING|Priority\n", encoding="utf-8")
    look()
    assert caplog.messages == told


def test_keys_whose_drawn_names_hold_the_number_of_a_job_are_no_logs_of_it(tmp_path: Path) -> None:
    """A job that waits would count as one that has begun and says nothing."""
    (tmp_path / ".dask-jobqueue.tls-a3-").touch()
    assert queue_workers._logs(tmp_path, "3") == []
    log = tmp_path / "slurm-3.out"
    log.touch()
    assert queue_workers._logs(tmp_path, "3") == [log]

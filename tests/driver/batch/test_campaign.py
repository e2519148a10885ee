from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from driver.batch.campaign import Campaign, Study, Trial, Use, read_campaign
from driver.batch.queues import REQUIRED, Cluster
from driver.case.values import Table
from driver.common.errors import InputError

DOCS = Path(__file__).resolve().parents[3] / "docs" / "batch.md"
TABLES: dict[str, type[Table]] = {
    "—": Campaign, "study": Study, "trial": Trial, "execution": Use, "cluster": Cluster,
}  # fmt: skip


def test_what_is_not_stated_has_its_default(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text('cases = ["*/case.toml"]\n')
    campaign = read_campaign(file)
    assert campaign.cases == ("*/case.toml",) and campaign.until == "report"
    assert not campaign.study and not campaign.trial
    assert campaign.execution.processes == campaign.execution.threads == 1
    assert campaign.execution.store is None
    assert campaign.execution.jobs is None and campaign.execution.memory_GB is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "cases: found nothing to run, expected cases, [[study]] or [[trial]]"),
        ("cases = 3", "cases: found 3, expected a list of case files or patterns"),
        ('cases = ["a"]\nuntil = "end"', 'until: found "end", expected "mesh", "measure"'),
        ('cases = ["a"]\n[execution]\njobs = 0', "execution.jobs: found 0, expected a number ≥ 1"),
        (
            'cases = ["a"]\n[execution]\njobs = 2\nscheduler = "tcp://a:1"',
            "execution.jobs: found 2, expected no such key beside scheduler",
        ),
        (
            'cases = ["a"]\n[execution]\nscheduler = "tcp://a:1"\n[cluster]',
            'execution.scheduler: found "tcp://a:1", expected no such key beside [cluster]',
        ),
        (
            'cases = ["a"]\n[cluster]\nsystem = "sge"',
            'cluster.system: found "sge", expected "slurm", "pbs" or "lsf"',
        ),
        (
            'cases = ["a"]\n[cluster]\nwalltime = "24:00"',
            'cluster.walltime: found "24:00", expected hours:minutes:seconds in quotes',
        ),
        (
            'cases = ["a"]\n[cluster]\nqueue = "short; rm"',
            'cluster.queue: found "short; rm", expected a word in quotes, the queue',
        ),
        (
            'cases = ["a"]\n[cluster]\njob_extra_directives = ["a\\nb"]',
            'cluster.job_extra_directives: found ["a\\nb"], expected a list of further directives',
        ),
        (
            'cases = ["a"]\n[cluster]\npartition = "short"',
            'cluster.partition: found an unknown key with the value "short", expected one of',
        ),
        (
            'cases = ["a"]\n[execution]\nstore = "~/jobs"',
            'execution.store: found "~/jobs", expected the path itself',
        ),
        ('[[study]]\ncase = "a"', "study.1.values: found nothing, expected lists of values by key"),
        ('[[study]]\ncase = "a"\nvalues.x = []', "study.1.values.x: found []"),
        ('[[trial]]\ncase = "a"\nseeds = [1, 1]', "trial.1.seeds: found 1 twice or more, expected"),
        (
            '[[trial]]\ncase = "a"\nseeds = [-1]',
            "trial.1.seeds: found [-1], expected a list",
        ),
        ('cases = ["a"]\njobs = 2', "jobs: found an unknown key with the value 2, expected one of"),
    ],
)
def test_a_bad_key_is_refused_in_one_sentence(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as error:
        read_campaign(file)
    assert str(error.value).startswith(f"{file}: {said}")
    assert "\n" not in str(error.value)


def test_a_cluster_may_have_a_store(tmp_path: Path) -> None:
    file = tmp_path / "campaign.toml"
    file.write_text('cases = ["a"]\n[execution]\nscheduler = "tcp://a:1"\nstore = "jobs"\n')
    assert read_campaign(file).execution.store == "jobs"


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found nothing, expected the file of a campaign"):
        read_campaign(tmp_path / "campaign.toml")


def test_every_key_is_documented_with_its_default() -> None:
    rows = re.findall(r"^\| (\S+) \| `(\w+)` \| (.*?) \|", DOCS.read_text("utf-8"), re.M)
    expected = {}
    for table, model in TABLES.items():
        for key, field in model.model_fields.items():
            if key in TABLES:
                continue
            if field.is_required() or (model is Cluster and key in REQUIRED):
                expected[table, key] = "required"
            else:
                default = field.default
                expected[table, key] = "—" if default is None else json.dumps(default)
    assert {(table.strip("`"), key): default for table, key, default in rows} == expected

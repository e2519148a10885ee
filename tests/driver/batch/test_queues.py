from __future__ import annotations

from pathlib import Path

import pytest

from driver.batch.queues import Cluster, profiles_path, queue_of
from driver.common.errors import InputError

FILE = Path("campaign.toml")


@pytest.fixture(autouse=True)
def profiles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of the user's queue systems, in a folder of the test."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    path = profiles_path()
    assert path == tmp_path / "prismid" / "clusters.toml"
    path.parent.mkdir()
    path.write_text(
        '[profiles.big]\nsystem = "slurm"\nwalltime = "02:00:00"\nqueue = "long"\n'
        'job_extra_directives = ["--qos=high"]\n[profiles.half]\nqueue = "short"\n'
    )
    return path


def test_what_the_campaign_says_goes_before_what_the_profile_says() -> None:
    stated = Cluster(profile="big", walltime="48:00:00", account="steel")
    queue = queue_of(stated, FILE)
    assert (queue.system, queue.queue, queue.account) == ("slurm", "long", "steel")
    assert queue.walltime == "48:00:00" and queue.seconds == 48 * 3600
    assert queue.job_extra_directives == ("--qos=high",)


def test_a_campaign_without_a_profile_reads_none(profiles: Path) -> None:
    profiles.unlink()
    queue = queue_of(Cluster(system="pbs", walltime="00:01:30"), FILE)
    assert queue.system == "pbs" and queue.seconds == 90


@pytest.mark.parametrize("stated", [Cluster(), Cluster(profile="half")])
def test_what_neither_of_them_says_is_told_at_once(stated: Cluster) -> None:
    with pytest.raises(InputError) as error:
        queue_of(stated, FILE)
    system, walltime = str(error.value).splitlines()
    assert system == (
        'campaign.toml: cluster.system: found nothing, expected "slurm", "pbs" or "lsf", the queue '
        "system"
    )
    assert walltime.startswith("campaign.toml: cluster.walltime: found nothing, expected hours:min")


def test_a_profile_that_is_not_there_is_told_with_those_that_are(profiles: Path) -> None:
    with pytest.raises(InputError) as error:
        queue_of(Cluster(profile="small"), FILE)
    assert str(error.value) == (
        f'campaign.toml: cluster.profile: found "small", expected one of big, half of {profiles}'
    )
    profiles.unlink()
    with pytest.raises(InputError, match=f"^{profiles}: file: found nothing, expected the file"):
        queue_of(Cluster(profile="small"), FILE)


def test_a_bad_profile_is_told_by_its_file_and_key(profiles: Path) -> None:
    profiles.write_text('[profiles.big]\nsystem = "slurm"\nprofile = "half"\nwalltime = 2\n')
    with pytest.raises(InputError) as error:
        queue_of(Cluster(profile="big"), FILE)
    one, other = sorted(str(error.value).splitlines())
    assert one.startswith(f"{profiles}: profiles.big.profile: found an unknown key with the value")
    assert other.startswith(f"{profiles}: profiles.big.walltime: found 2, expected")

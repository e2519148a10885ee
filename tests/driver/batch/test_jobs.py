from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from driver.batch.campaign import Campaign, Study, Trial, Use
from driver.batch.jobs import Job, jobs_of, most_at_a_time
from driver.case.model import load_case
from driver.common.errors import InputError
from driver.workflow.cost import Cost
from tests.driver.batch.cases import write_small_case


def study(**values: list[object]) -> Campaign:
    keys = {key.replace("__", "."): tuple(some) for key, some in values.items()}
    return Campaign(study=(Study(case="base/case.toml", values=keys),))


@pytest.fixture
def file(tmp_path: Path) -> Path:
    write_small_case(tmp_path / "base")
    return tmp_path / "campaign.toml"


def test_a_pattern_names_cases_by_their_files_and_by_their_folders(file: Path) -> None:
    write_small_case(file.parent / "more" / "second")
    for pattern in ("**/case.toml", "more/*"):
        jobs = jobs_of(Campaign(cases=(pattern,)), file)
        assert [job.name for job in jobs] == ["base", "more/second"][-len(jobs) :]
    (job,) = jobs
    assert job.case == file.parent / "more" / "second" / "case.toml"
    (call,) = job.calls
    assert call == (
        "run", str(job.case), "--until", "report", "--processes", "1", "--threads", "1",
    )  # fmt: skip
    assert job.cost.seconds > 0 and job.cost.memory > 1e8
    assert job.log.parent == file.parent / "campaign.batch" / "logs"


def test_a_study_has_a_case_for_each_combination_which_reads_the_same_files(file: Path) -> None:
    campaign = study(loads__noise_uN=[1.0, 2.0], grains__2__name=["x", "y"])
    jobs = jobs_of(campaign, file)
    assert [job.name for job in jobs] == [
        f"loads.noise_uN={noise}, grains.2.name={name}" for noise in (1.0, 2.0) for name in "xy"
    ]
    base = load_case(file.parent / "base" / "case.toml")
    for job, (noise, name) in zip(jobs, ((n, s) for n in (1.0, 2.0) for s in "xy"), strict=True):
        case = load_case(job.case)
        assert case.loads.noise_uN == noise and case.grains[1].name == name
        assert case.path(case.history.file).samefile(base.path(base.history.file))
        assert case.images.frames is not None and case.path(case.images.frames).is_file()
        assert case.specimen == base.specimen
    assert len({job.log for job in jobs}) == 4


def test_what_a_study_has_written_stays_until_it_changes(file: Path) -> None:
    (job,) = jobs_of(study(loads__noise_uN=[1.0]), file)
    before = job.case.stat().st_mtime_ns
    jobs_of(study(loads__noise_uN=[1.0]), file)
    assert job.case.stat().st_mtime_ns == before
    base = file.parent / "base" / "case.toml"
    base.write_text(base.read_text("utf-8").replace('name = "grain 1"', 'name = "other"'), "utf-8")
    jobs_of(study(loads__noise_uN=[1.0]), file)
    assert load_case(job.case).grains[0].name == "other"


def test_a_case_that_no_campaign_wrote_is_not_written_over(file: Path) -> None:
    (job,) = jobs_of(study(loads__noise_uN=[1.0]), file)
    mine = "# Mine.\n" + job.case.read_text("utf-8")
    job.case.write_text(mine, "utf-8")
    with pytest.raises(InputError, match="found a case that no campaign wrote, expected none"):
        jobs_of(study(loads__noise_uN=[1.0]), file)
    assert job.case.read_text("utf-8") == mine


def test_each_virtual_experiment_is_made_once_and_not_of_another_case(file: Path) -> None:
    campaign = Campaign(trial=(Trial(case="base/case.toml", seeds=(3, 4)),))
    first, second = jobs_of(campaign, file)
    assert (first.name, second.name) == ("base_seed_3", "base_seed_4")
    making, run = first.calls
    assert making == (
        "virtual", str(file.parent / "base" / "case.toml"), "--to", str(first.case.parent),
        "--seed", "3",
    )  # fmt: skip
    assert run[:2] == ("run", str(first.case)) and first.truth
    write_small_case(first.case.parent)
    again, _ = jobs_of(campaign, file)
    assert again.calls == (run,)
    base = file.parent / "base" / "case.toml"
    base.write_text(base.read_text("utf-8").replace('name = "grain 1"', 'name = "other"'), "utf-8")
    with pytest.raises(InputError, match="found an experiment of another case"):
        jobs_of(campaign, file)


def test_all_that_cannot_be_run_is_told_at_once(file: Path) -> None:
    campaign = Campaign(
        cases=("none/*", "base/case.toml", "base"),
        study=(Study(case="base/case.toml", values={"loads.noise_uN": (-1.0,)}),),
        trial=(Trial(case="gone.toml", seeds=(1,)),),
    )
    with pytest.raises(InputError) as error:
        jobs_of(campaign, file)
    folder = file.parent
    assert str(error.value).splitlines() == [
        f'{file}: cases.1: found no file "none/*", expected case files or their folders',
        f"{file}: loads.noise_uN: found -1.0, expected a number > 0 (standard deviation at "
        "specimen scale)",
        f"{folder}/gone.toml: file: found nothing, expected a case file (`prismid init DIR` writes "
        "one)",
        f"{file}: cases: found {folder}/base/case.toml twice, expected each case once",
    ]


def test_a_case_that_cannot_be_used_is_a_job_that_fails_by_itself(file: Path) -> None:
    bad = file.parent / "bad" / "case.toml"
    bad.parent.mkdir()
    bad.write_text("[specimen]\nlength_um = -1.0\n")
    other, good = jobs_of(Campaign(cases=("*/case.toml",)), file)
    assert (good.name, other.name) == ("base", "bad") and good.cost.memory > 0
    assert other.calls == (("run", str(bad)),) and other.cost == Cost(0.0, 0.0, 0)


def test_jobs_at_a_time_are_what_cores_and_memory_hold(file: Path) -> None:
    (job,) = jobs_of(Campaign(cases=("base",)), file)
    jobs = [replace(job, cost=Cost(1.0, 2e9, 1)) for _ in range(9)]

    def most(cores: int, memory: float, some: list[Job] = jobs, **use: Any) -> int:
        return most_at_a_time(some, Campaign(cases=("x",), execution=Use(**use)), cores, memory)

    assert most(8, 64e9) == 8 and most(32, 64e9) == 9
    assert most(8, 64e9, processes=2) == 4 and most(8, 64e9, processes=2, threads=2) == 2
    assert most(2, 64e9, jobs=5) == 5
    assert most(8, 7e9) == 3 and most(8, 64e9, memory_GB=4.0) == 2
    assert most(8, 1e9) == 1 and most(8, 64e9, jobs[:1]) == 1

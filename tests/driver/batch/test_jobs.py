from __future__ import annotations

import os
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from driver.batch import jobs as jobs_module
from driver.batch.campaign import Campaign, Study, Trial, Use
from driver.batch.jobs import Job, jobs_of, most_at_a_time, write_files
from driver.case.model import Case, load_case, write_case
from driver.case.solver import ProfileTable
from driver.common.errors import InputError
from driver.workflow.cost import Cost
from driver.workflow.pipeline import cost_of_run
from tests.driver.batch.cases import write_small_case


def study(**values: list[object]) -> Campaign:
    keys = {key.replace("__", "."): tuple(some) for key, some in values.items()}
    return Campaign(study=(Study(case="base/case.toml", values=keys),))


def written(campaign: Campaign, file: Path) -> list[Job]:
    jobs = jobs_of(campaign, file)
    write_files(jobs)
    return jobs


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


def test_all_cases_of_a_campaign_have_its_store(file: Path) -> None:
    use = Use(store="../all jobs")
    whole = Campaign(cases=("base",), study=study(loads__noise_uN=[1.0]).study, execution=use)
    for job in jobs_of(whole, file):
        assert job.calls[-1][-2:] == ("--store", str(file.parent.parent / "all jobs"))


def test_a_study_has_a_case_for_each_combination_which_reads_the_same_files(file: Path) -> None:
    campaign = study(loads__noise_uN=[1.0, 2.0], grains__2__name=["x", "y"])
    jobs = written(campaign, file)
    assert [job.name for job in jobs] == [
        f"base loads.noise_uN={noise}, grains.2.name={name}"
        for noise in (1.0, 2.0)
        for name in "xy"
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
    (job,) = written(study(loads__noise_uN=[1.0]), file)
    before = job.case.stat().st_mtime_ns
    written(study(loads__noise_uN=[1.0]), file)
    assert job.case.stat().st_mtime_ns == before
    base = file.parent / "base" / "case.toml"
    base.write_text(base.read_text("utf-8").replace('name = "grain 1"', 'name = "other"'), "utf-8")
    written(study(loads__noise_uN=[1.0]), file)
    assert load_case(job.case).grains[0].name == "other"


def test_a_case_that_no_campaign_wrote_is_not_written_over(file: Path) -> None:
    (job,) = written(study(loads__noise_uN=[1.0]), file)
    mine = "# Mine.\n" + job.case.read_text("utf-8")
    job.case.write_text(mine, "utf-8")
    with pytest.raises(InputError, match="found a case that no campaign wrote, expected none"):
        written(study(loads__noise_uN=[1.0]), file)
    assert job.case.read_text("utf-8") == mine


def test_each_virtual_experiment_is_made_once_and_not_of_another_case(file: Path) -> None:
    campaign = Campaign(trial=(Trial(case="base/case.toml", seeds=(3, 4)),))
    first, second = written(campaign, file)
    assert (first.name, second.name) == ("base seed 3", "base seed 4")
    making, run = first.calls
    assert making[0] == "virtual" and making[2:6] == (
        "--to", str(first.case.parent), "--seed", "3",
    )  # fmt: skip
    # What it is made from is kept as it was.
    copy = load_case(Path(making[1]))
    base = load_case(file.parent / "base" / "case.toml")
    assert copy.grains == base.grains and copy.path(copy.history.file).is_file()
    assert run[:2] == ("run", str(first.case)) and first.made == first.case.parent
    write_small_case(first.case.parent)
    again, _ = jobs_of(campaign, file)
    assert again.calls == (run,) and again.made is None
    path = file.parent / "base" / "case.toml"
    path.write_text(path.read_text("utf-8").replace('name = "grain 1"', 'name = "other"'), "utf-8")
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
    case = f"{folder}/base/case.toml"
    assert str(error.value).splitlines() == [
        f'{file}: cases.1: found no case "none/*", expected case files or their folders',
        f"{file}: study.1.values: loads.noise_uN: found -1.0, expected a number > 0 (standard "
        "deviation at specimen scale)",
        f"{folder}/gone.toml: file: found nothing, expected a case file (`prismid init DIR` writes "
        "one)",
        f"{file}: cases.3: found {case}, which has the name or the results of {case} (cases.2), "
        "expected each case once, in a folder of its own",
    ]
    assert not file.with_suffix(".batch").exists()


def test_two_cases_that_would_have_the_same_results_are_refused(file: Path) -> None:
    base = file.parent / "base" / "case.toml"
    (file.parent / "base" / "other.toml").write_text(base.read_text("utf-8"), "utf-8")
    (file.parent / "link").symlink_to(file.parent / "base")
    for other in ("base/other.toml", "link"):
        with pytest.raises(InputError, match=r"cases.2: found .*, which has the name or the resul"):
            jobs_of(Campaign(cases=("base", other)), file)


def test_a_wildcard_takes_in_no_case_of_the_campaign_and_no_other_file(file: Path) -> None:
    file.write_text("")
    (job,) = written(study(loads__noise_uN=[1.0]), file)
    (file.parent / "base" / "results").mkdir()
    (file.parent / "base" / "results" / "extended.toml").write_text("")
    (file.parent / "notes.txt").write_text("")
    (file.parent / "empty").mkdir()
    for pattern in ("**", "*"):
        assert [job.name for job in jobs_of(Campaign(cases=(pattern,)), file)] == ["base"]


def test_a_folder_whose_name_looks_like_a_pattern_is_no_pattern(tmp_path: Path) -> None:
    folder = tmp_path / "proj [2024]"
    write_small_case(folder / "x[1]")
    for pattern in ("x[1]", "x*"):
        (job,) = jobs_of(Campaign(cases=(pattern,)), folder / "campaign.toml")
        assert job.name == "x[1]"


def test_studies_and_trials_of_two_cases_have_names_of_their_own(file: Path) -> None:
    write_small_case(file.parent / "second")
    values = {"loads.noise_uN": (1.0,)}
    campaign = Campaign(
        study=tuple(Study(case=case, values=values) for case in ("base/case.toml", "second")),
        trial=tuple(Trial(case=case, seeds=(1,)) for case in ("base", "second")),
    )
    assert len({job.log for job in jobs_of(campaign, file)}) == 4


@pytest.mark.parametrize(
    ("values", "said"),
    [
        (
            {"boundary.lambda_start": (3,), "boundary.lambda_start.plus_Y": (0.9,)},
            'study.1.values: found "boundary.lambda_start" beside "boundary.lambda_start.plus_Y"',
        ),
        ({"loads.noise_uN": (8.0, 8)}, "study.1.values.loads.noise_uN: found 8 twice"),
        ({"specimen.length_um": (date(2020, 1, 1),)}, "study.1.values: specimen.length_um: found"),
        ({"grains.3.name": ("x",)}, "study.1.values: grains.3.name=x: found the entry 3 of a lis"),
    ],
)
def test_values_that_contradict_one_another_or_the_case_are_refused(
    file: Path, values: dict[str, tuple[Any, ...]], said: str
) -> None:
    with pytest.raises(InputError) as error:
        jobs_of(Campaign(study=(Study(case="base", values=values),)), file)
    assert str(error.value).startswith(f"{file}: {said}")


def test_all_values_that_cannot_be_used_are_told(file: Path) -> None:
    with pytest.raises(InputError) as error:
        jobs_of(study(loads__noise_uN=[-1.0, 2.0, -3.0]), file)
    assert [line.partition("found ")[2][:2] for line in str(error.value).splitlines()] == [
        "-1", "-3",
    ]  # fmt: skip


def test_names_of_files_are_short_and_say_nothing_of_the_version(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = study(grains__1__name=["x" * 300, "漢" * 90, "a/b"])
    before = [job.case for job in jobs_of(campaign, file)]
    assert all(len(path.parent.name.encode()) <= 100 for path in before)
    assert len(set(before)) == 3
    monkeypatch.setattr(jobs_module, "prismid_version", lambda: "next")
    assert [job.case for job in jobs_of(campaign, file)] == before


def test_a_study_of_a_case_above_the_campaign_is_not_in_a_hidden_folder(file: Path) -> None:
    beside = file.parent / "campaigns" / "campaign.toml"
    beside.parent.mkdir()
    values = {"loads.noise_uN": (1.0,)}
    campaign = Campaign(study=(Study(case="../base/case.toml", values=values),))
    (job,) = jobs_of(campaign, beside)
    parts = [*job.case.relative_to(beside.parent).parts, job.log.name]
    assert not any(part.startswith(".") for part in parts)


def test_what_no_terminal_or_table_shows_is_left_out_of_names(tmp_path: Path) -> None:
    for folder in (b"x\xff", b"x\x1b[31m"):
        write_small_case(tmp_path / os.fsdecode(folder))
    names = [job.name for job in jobs_of(Campaign(cases=("x*",)), tmp_path / "campaign.toml")]
    assert sorted(names) == ["x�", "x�[31m"]
    assert all(name.isprintable() and name.encode() for name in names)


def test_what_is_done_takes_no_time(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = Campaign(cases=("base",))
    assert jobs_of(campaign, file)[0].cost.seconds > 0
    monkeypatch.setattr(jobs_module, "stages_done", lambda path: frozenset({"report"}))
    (job,) = jobs_of(campaign, file)
    assert job.cost.seconds == 0 and job.cost.memory > 0


def test_a_case_that_cannot_be_used_is_a_job_that_fails_by_itself(file: Path) -> None:
    bad = file.parent / "bad" / "case.toml"
    bad.parent.mkdir()
    bad.write_text("[specimen]\nlength_um = -1.0\n")
    other, good = jobs_of(Campaign(cases=("*/case.toml",)), file)
    assert (good.name, other.name) == ("base", "bad") and good.cost.memory > 0
    assert other.calls == (("run", str(bad), "--until", "report"),) and other.cost == Cost(
        0.0, 0.0, 0
    )


def test_a_case_at_which_prismid_has_a_fault_is_a_job_that_fails_by_itself(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_small_case(file.parent / "other")

    def faulty(case: Case, *asked: int) -> Cost:
        if case.file.parent.name == "other":
            raise KeyError("a bug")
        return cost_of_run(case, *asked)

    monkeypatch.setattr(jobs_module, "cost_of_run", faulty)
    good, other = jobs_of(Campaign(cases=("*/case.toml",)), file)
    assert good.cost.seconds > 0 and other.calls == (("run", str(other.case), "--until", "report"),)


def test_a_job_takes_the_cores_of_its_processes_or_of_the_jobs_of_its_solver(file: Path) -> None:
    campaign = Campaign(cases=("base",), execution=Use(processes=3, threads=2))
    (job,) = jobs_of(campaign, file)
    assert job.cores == 6
    path = file.parent / "base" / "case.toml"
    jobs = {"solver.name": "code_aster", "solver.profiles": {"code_aster": ProfileTable(threads=4)}}
    write_case(load_case(path).with_values_at(jobs), path)
    (job,) = jobs_of(campaign, file)
    assert job.cores == 12


def test_jobs_at_a_time_are_what_cores_and_memory_hold(file: Path) -> None:
    (job,) = jobs_of(Campaign(cases=("base",)), file)
    jobs = [replace(job, cost=Cost(1.0, 2e9, 1)) for _ in range(9)]

    def most(
        cores: int, memory: float, some: list[Job] = jobs, of_each: int = 1, **use: Any
    ) -> int:
        some = [replace(job, cores=of_each) for job in some]
        return most_at_a_time(some, Campaign(cases=("x",), execution=Use(**use)), cores, memory)

    assert most(8, 64e9) == 8 and most(32, 64e9) == 9
    assert most(8, 64e9, of_each=2) == 4 and most(8, 64e9, of_each=4) == 2
    assert most(2, 64e9, jobs=5) == 5
    assert most(8, 7e9) == 3 and most(8, 64e9, memory_GB=4.0) == 2
    assert most(8, 1e9) == 1 and most(8, 64e9, jobs[:1]) == 1

"""The file of a campaign, `prismid batch campaign.toml`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import Field, model_validator

from driver.batch.queues import Cluster
from driver.case.messages import refusal
from driver.case.toml import read_tables, read_toml
from driver.case.values import Few, FileName, NewFolder, Positive, Table
from driver.common.errors import InputError, sentence
from driver.common.stage_names import StageName

Seed = Annotated[int, Field(strict=True, ge=0)]


class Study(Table):
    """Variants of a case: each combination of the values of some keys."""

    case: FileName = Field(description="a text in quotes, the case file")
    values: dict[str, Annotated[tuple[Any, ...], Field(min_length=1)]] = Field(
        min_length=1, description='lists of values by key, as "specimen.mesh_size_um" = [2.0, 1.0]'
    )


class Trial(Table):
    """Virtual experiments of a case, whose truth is known."""

    case: FileName = Field(description="a text in quotes, the case file")
    settings: FileName | None = Field(
        default=None, description="a text in quotes, the settings of `prismid virtual`"
    )
    seeds: Annotated[tuple[Seed, ...], Field(min_length=1)] = Field(
        description="a list of whole numbers ≥ 0, one for each experiment"
    )

    @model_validator(mode="after")
    def _each_seed_once(self) -> Self:
        for seed in self.seeds:
            if self.seeds.count(seed) > 1:
                raise refusal("each number once", "seeds", f"{seed} twice or more")
        return self


class Use(Table):
    """Use of the machine by all jobs together."""

    jobs: Few | None = Field(
        default=None,
        description="jobs at a time, default as many as cores and memory hold",
    )
    processes: Few = Field(default=1, description="processes of each job")
    threads: Few = Field(default=1, description="threads of each process")
    memory_GB: Positive | None = Field(
        default=None, description="memory of all jobs together, default that of the machine"
    )
    scheduler: FileName | None = Field(
        default=None,
        description="a text in quotes, the address of a Dask scheduler whose workers carry out the "
        "jobs",
    )
    store: NewFolder | None = Field(
        default=None,
        description="a text in quotes, the folder of the jobs of solvers that are programs of "
        "their own, for all cases",
    )

    @model_validator(mode="after")
    def _nothing_that_a_cluster_ignores(self) -> Self:
        of_all = ("processes", "threads", "scheduler", "store")
        of_this_machine = {k: v for k, v in self if k not in of_all}
        for key, value in of_this_machine.items():
            if self.scheduler is not None and value is not None:
                expected = "no such key beside scheduler: its workers are as many as were started"
                raise refusal(expected, key)
        return self


class Campaign(Table):
    """What is run."""

    cases: tuple[FileName, ...] = Field(
        default=(), description='a list of case files or patterns, as ["specimens/*/case.toml"]'
    )
    until: StageName = Field(default="report", description="the last stage of each case")
    study: tuple[Study, ...] = Field(default=(), description="tables [[study]]")
    trial: tuple[Trial, ...] = Field(default=(), description="tables [[trial]]")
    execution: Use = Use()
    cluster: Cluster | None = Field(
        default=None,
        description="a table, the queue system whose jobs carry out the cases",
    )

    @model_validator(mode="after")
    def _one_place_to_run(self) -> Self:
        if self.cluster is not None:
            for key in ("scheduler", "memory_GB"):
                if getattr(self.execution, key) is not None:
                    expected = "no such key beside [cluster], which says where the cases run"
                    raise refusal(expected, f"execution.{key}")
        return self

    @model_validator(mode="after")
    def _something_to_run(self) -> Self:
        if not (self.cases or self.study or self.trial):
            raise refusal("cases, [[study]] or [[trial]]", "cases", "nothing to run")
        return self


def read_campaign(path: Path) -> Campaign:
    """Return what stands in the file of a campaign.

    Raises:
        InputError: the file is absent or no TOML, or a key is unknown or out of range.
    """
    expected = "the file of a campaign"
    if {"specimen", "grains"} & set(read_toml(path, expected)):
        raise InputError(sentence(path, "file", "a case", f"{expected}; `prismid run` runs a case"))
    return read_tables(path, Campaign, expected)

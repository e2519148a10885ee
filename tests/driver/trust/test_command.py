"""`prismid trust` shows what a file asks for, and asks once."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from driver.case.consent import trusted_path
from driver.case.model import default_case, write_case
from driver.case.solver import ProfileTable
from driver.cli import app

CAMPAIGN = """
cases = ["*/case.toml"]
[cluster]
system = "slurm"
walltime = "1:00:00"
job_script_prologue = ["module load calculix"]
"""


@pytest.fixture(autouse=True)
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PRISMID_CONFIG", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))


def trust(file: Path, *options: str, answer: str = "") -> tuple[int, str]:
    found = CliRunner().invoke(app, ["trust", str(file), *options], input=answer)
    return found.exit_code, found.output


def case_with_command(folder: Path, *words: str) -> Path:
    plain, path = default_case(), folder / "case.toml"
    solver = plain.solver.model_copy(update={"profiles": {"bar": ProfileTable(command=words)}})
    write_case(plain.model_copy(update={"solver": solver}), path)
    return path


def test_a_case_that_asks_for_nothing_needs_no_answer(tmp_path: Path) -> None:
    write_case(default_case(), tmp_path / "case.toml")
    code, said = trust(tmp_path)
    assert (code, said) == (0, f"{tmp_path}/case.toml: nothing to agree to\n")
    assert not trusted_path().exists()


def test_a_command_is_shown_and_kept_only_where_the_user_agrees(tmp_path: Path) -> None:
    path = case_with_command(tmp_path, "docker", "run", "bar")
    line = "solver.profiles.bar.command: a command: docker run bar"
    code, said = trust(path, answer="n\n")
    assert code == 1 and line in said and not trusted_path().exists()
    code, said = trust(path, answer="y\n")
    assert code == 0 and line in said and f"kept in {trusted_path()}" in said
    assert trust(path) == (0, f"{path}: nothing to agree to\n")


def test_results_that_lead_elsewhere_are_shown(tmp_path: Path) -> None:
    write_case(default_case(), tmp_path / "case.toml")
    (tmp_path / "scratch").mkdir()
    (tmp_path / "results").symlink_to("scratch")
    code, said = trust(tmp_path, "--yes")
    assert code == 0 and said.startswith(f"results: a link: {tmp_path}/scratch\n")


def test_lines_of_a_job_script_and_a_scheduler_of_a_campaign_are_shown(tmp_path: Path) -> None:
    path = tmp_path / "campaign.toml"
    path.write_text(CAMPAIGN)
    code, said = trust(path, "--yes")
    assert code == 0
    line = "cluster.job_script_prologue: lines of a job script: module load calculix"
    assert said.startswith(line + "\n")
    path.write_text('cases = ["a.toml"]\n[execution]\nscheduler = "tcp://node:8786"\n')
    code, said = trust(path, "--yes")
    assert code == 0 and said.startswith("execution.scheduler: a scheduler: tcp://node:8786\n")


def test_a_file_that_is_neither_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "other.toml"
    path.write_text("a = 1\n")
    code, said = trust(path)
    assert code == 1 and said.startswith(f"prismid: {path}: a: found an unknown key")
    assert len(said.splitlines()) == 1

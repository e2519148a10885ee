"""`prismid cache` as a user calls it, on jobs of a small program."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from driver.cache.command import store_at, table_of, to_prune, total_of
from driver.case.model import default_case, write_case
from driver.cli import app
from driver.common.errors import InputError
from solver_adapters.job_store import StoredJob, stored_jobs
from solver_adapters.jobs.errors import JobError
from solver_adapters.jobs.lock import sole_process
from tests.solver_adapters.bar import SIMULATION, bar, folders


def invoke(*arguments: object, answer: str | None = None) -> Result:
    words = ["cache", *(str(argument) for argument in arguments)]
    return CliRunner().invoke(app, words, input=answer)


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """A store with a job that is done and one that was killed."""
    made = tmp_path / "jobs"
    bar(asker="/cases/[a]/case.toml").solve(SIMULATION, made)
    with pytest.raises(JobError):
        bar("import os; os.kill(os.getpid(), 9)").solve(SIMULATION, made)
    return made


def job(state: str, days: float = 0.0, holder: str = "") -> StoredJob:
    return StoredJob(Path(state), 64 * "a", state, "bar: 1", "", 1000, -86_400 * days, holder)


def test_a_list_has_a_row_for_each_job_and_a_total(store: Path) -> None:
    listed = invoke("list", store)
    assert listed.exit_code == 0
    head, *rows, total = listed.stdout.splitlines()
    assert head.split() == ["job", "state", "size", "last", "used", "solver", "asked", "for", "by"]
    done, killed = sorted(rows, key=lambda row: "killed" in row)
    (key,) = (name for name in folders(store) if len(name) == 64)
    assert done.startswith(f"{key[:12]}  done") and f"bar: {bar().version()}" in done
    assert done.rstrip().endswith("/cases/[a]/case.toml") and " kB " in done and " s ago " in done
    assert " killed " in killed
    assert total.startswith(f"{store}: 2 jobs (") and total.endswith(" kB")
    assert "1 done" in total and "1 killed" in total


def test_the_store_of_a_case_is_found_from_its_file_from_its_folder_and_from_inside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    case = default_case().with_values_at({"execution.store": "../jobs"})
    (tmp_path / "a").mkdir()
    write_case(case, tmp_path / "a" / "case.toml")
    write_case(default_case(), tmp_path / "a" / "other.toml")
    monkeypatch.chdir(tmp_path / "a")
    for path in (tmp_path / "a" / "case.toml", tmp_path / "a", Path()):
        assert store_at(path).resolve() == tmp_path / "jobs"
    assert store_at(Path("other.toml")).resolve() == tmp_path / "a" / "results" / "jobs"
    assert store_at(tmp_path) == tmp_path
    assert invoke("list").stdout == f"{tmp_path / 'jobs'}: no jobs\n"


def test_verify_names_what_does_not_match_and_its_exit_code_is_1(store: Path) -> None:
    assert invoke("verify", store).stdout == f"{store}: 1 job as written\n"
    (response,) = store.glob("*/response.h5")
    response.write_bytes(response.read_bytes()[:-1])
    found = invoke("verify", store)
    assert found.exit_code == 1
    fault, outcome = found.stdout.splitlines()
    assert fault.startswith(f"{response}: found a file of another content, expected the one that")
    assert outcome == f"{store}: 0 jobs as written, 1 job not"


def test_prune_tells_what_it_removes_and_asks(store: Path) -> None:
    before = folders(store)
    for answer in ("n\n", "", "\n"):
        refused = invoke("prune", store, "--failed", answer=answer)
        assert refused.exit_code == 1 and folders(store) == before
        assert " killed " in refused.stdout and " done " not in refused.stdout
        assert "Remove 1 job, " in refused.stdout and " B? [y/N]" in refused.stdout.replace("k", "")
    done = invoke("prune", store, "--failed", answer="y\n")
    assert done.exit_code == 0 and done.stdout.splitlines()[-1].endswith(" freed")
    assert folders(store) == [name for name in before if len(name) == 64]
    assert invoke("prune", store, "--failed").stdout == f"{store}: nothing to remove\n"


def test_prune_removes_without_a_question_what_was_not_used_for_long(store: Path) -> None:
    (key,) = (name for name in folders(store) if len(name) == 64)
    for path in (*(store / key).iterdir(), store / key):
        os.utime(path, (1e9, 1e9))
    assert "nothing to remove" in invoke("prune", store, "--failed", "--older-than", 1).stdout
    assert invoke("prune", store, "--older-than", 1, "--yes").exit_code == 0
    assert [name.partition(".")[2] for name in folders(store)] == ["killed"]


def test_a_job_that_is_taken_up_while_prune_asks_stays_and_is_told(
    store: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (key,) = (name for name in folders(store) if len(name) == 64)
    with sole_process(store / key, pytest.fail):
        # As it was before another process took it.
        before = stored_jobs(store)
        free = [StoredJob(**{**vars(job), "holder": ""}) for job in before]
        monkeypatch.setattr("driver.cache.command.stored_jobs", lambda path: free)
        told = invoke("prune", store, "--older-than", 0, "--yes")
    assert f"{store / key}: not removed, process {os.getpid()} on " in told.stdout
    assert (store / key).is_dir() and told.exit_code == 0


@pytest.mark.parametrize(
    ("failed", "older_than", "states"),
    [
        (True, None, ["killed", "unfinished", "damaged"]),
        (False, 3.0, ["done", "prepared", "killed"]),
        (True, 3.0, ["killed"]),
        (False, 5.0, []),
    ],
)
def test_what_is_pruned_is_what_is_asked_for_and_never_at_work(
    failed: bool, older_than: float | None, states: list[str]
) -> None:
    jobs = [
        job("done", 4.0), job("did not converge"), job("prepared", 4.0), job("killed", 4.0),
        job("unfinished"), job("damaged"), job("running", 4.0, "process 1 on node7"),
        job("no record", 4.0), job("done", 4.0, "process 2 on node7"),
    ]  # fmt: skip
    chosen = to_prune(jobs, failed, older_than, 0.0)
    assert [job.state for job in chosen] == states
    assert not any(job.holder for job in chosen)


def test_a_row_tells_who_works_on_a_job_and_no_character_that_a_terminal_obeys() -> None:
    row = StoredJob(Path("a"), 64 * "a", "running", "bar: \x1b[2J", "", 1, 0.0, "process 1 on b")
    table = table_of([row], 10.0)
    columns = [list(column.cells)[0] for column in table.columns]
    assert columns[:5] == ["a" * 12, "running (process 1 on b)", "1 B", "10 s ago", "bar: �\\[2J"]
    assert total_of(Path("s"), [row]) == "s: 1 job (1 running), 1 B"


@pytest.mark.parametrize("verb", ["list", "verify", "prune"])
def test_what_is_no_store_is_told_in_one_sentence(verb: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no table")
    case = default_case().with_values_at({"execution.store": "file"})
    write_case(case, tmp_path / "stored.toml")
    (tmp_path / "bad.toml").write_text("[execution]\nstore = 5\n")
    more = ("--failed",) if verb == "prune" else ()
    for name, words in (
        ("nothing", "FOLDER: found nothing, expected a folder of jobs, or a case"),
        ("file", "expected a TOML file in UTF-8"),
        ("bad.toml", "execution.store: found 5, expected a text in quotes"),
        ("stored.toml", "file: store: found a file, expected a folder of jobs, or nothing yet"),
    ):
        told = invoke(verb, tmp_path / name, *more)
        assert told.exit_code == 1 and not told.stdout
        assert any(words in line for line in told.stderr.splitlines())
        assert all(line.startswith("prismid: ") for line in told.stderr.splitlines())


def test_prune_wants_to_be_told_what_goes(store: Path) -> None:
    with pytest.raises(InputError, match="expected --failed, --older-than DAYS or both"):
        to_prune(stored_jobs(store), False, None, 0.0)
    assert invoke("prune", store, "--older-than", -1).exit_code == 2

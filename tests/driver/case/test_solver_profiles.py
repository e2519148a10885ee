"""A profile is what the case says over what the user says over the defaults."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from driver.case.consent import ConsentError, agree
from driver.case.model import Case, default_case, load_case, write_case
from driver.case.solver import ProfileTable
from driver.case.solver_profiles import ConfigError, profile_of, requests_of_profiles
from solver_adapters.profile import Profile, config_path


def case(**entries: Any) -> Case:
    """A case for the solver "bar" with a profile."""
    plain = default_case()
    profiles = {"bar": ProfileTable(**entries)} if entries else {}
    solver = plain.solver.model_copy(update={"name": "bar", "profiles": profiles})
    return plain.model_copy(update={"solver": solver})


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "config.toml"
    monkeypatch.setenv("PRISMID_CONFIG", str(path))
    path.write_text(
        '[profiles.bar]\ncommand = ["bar", "-q"]\nmemory_MB = 9000\nwall_time_s = 7.5\n'
        "[profiles.other]\nthreads = 3\n"
    )
    return path


@pytest.fixture
def nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.delenv("PRISMID_CONFIG", raising=False)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    return tmp_path / "prismid" / "config.toml"


@pytest.mark.usefixtures("nothing")
def test_without_any_entry_the_defaults_count() -> None:
    assert profile_of(case()) == Profile()
    assert profile_of(case(), prepare_only=True) == Profile(prepare_only=True)


@pytest.mark.usefixtures("nothing")
def test_jobs_are_asked_for_by_the_file_of_the_case(tmp_path: Path) -> None:
    write_case(case(), tmp_path / "mine.toml")
    assert profile_of(load_case(tmp_path / "mine.toml")).asker == str(tmp_path / "mine.toml")


@pytest.mark.usefixtures("config")
def test_the_user_states_it_for_all_cases() -> None:
    expected = Profile(("bar", "-q"), memory=9000.0, wall_time=7.5)
    assert profile_of(case()) == expected


@pytest.mark.usefixtures("config", "willing")
def test_the_case_overrides_entry_by_entry() -> None:
    found = profile_of(case(command=["/opt/bar"], cpu_time_s=5.0))
    assert (found.command, found.memory, found.cpu_time) == (("/opt/bar",), 9000.0, 5.0)


def test_the_file_of_the_user_is_where_the_system_keeps_such_files(nothing: Path) -> None:
    assert config_path() == nothing
    nothing.parent.mkdir()
    nothing.write_text("[profiles.bar]\nthreads = 4\n")
    assert profile_of(case()).threads == 4


@pytest.mark.usefixtures("nothing", "willing")
def test_files_of_a_call_are_sought_from_the_file_of_the_case(tmp_path: Path) -> None:
    folder = tmp_path / "cases"
    (folder / "bin").mkdir(parents=True)
    for name in ("bin/solve", "wrapper.py", "python3"):
        (folder / name).touch()

    def command(*words: str) -> tuple[str, ...]:
        stated = case(command=words)
        stated._file = folder / "case.toml"
        return profile_of(stated).command

    wrapper, solve = str(folder / "wrapper.py"), str(folder / "bin" / "solve")
    found = command("python3", "wrapper.py", "bin", "-q", "absent.py")
    assert found == ("python3", wrapper, "bin", "-q", "absent.py")
    assert command("bin/solve", "./wrapper.py") == (solve, wrapper)
    assert command("./absent", 300 * "x") == ("./absent", 300 * "x")


def test_files_of_a_call_of_the_user_are_sought_from_that_file(config: Path) -> None:
    (config.parent / "wrapper.py").touch()
    config.write_text('[profiles.bar]\ncommand = ["python3", "wrapper.py"]\n')
    assert profile_of(case()).command == ("python3", str(config.parent / "wrapper.py"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[profiles.bar]\nthreads = 0\n", "profiles.bar.threads: found 0, expected a number ≥ 1"),
        ("[solvers.bar]\n", "solvers: found an unknown key with the value .*, expected one of"),
        ("[profiles.bar", "file: found “.*”, expected a TOML file in UTF-8"),
    ],
)
def test_a_bad_configuration_is_told_in_one_sentence(config: Path, text: str, said: str) -> None:
    config.write_text(text)
    with pytest.raises(ConfigError, match=f"^{config}: {said}"):
        profile_of(case())


def test_a_file_that_was_named_must_be_there(config: Path) -> None:
    config.unlink()
    with pytest.raises(ConfigError, match="found nothing, expected the file that PRISMID_CONFIG"):
        profile_of(case())


def test_an_empty_variable_names_no_file(nothing: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PRISMID_CONFIG", "")
    assert config_path() == nothing
    assert profile_of(case()) == Profile()


def test_a_file_in_the_place_of_the_file_is_told_in_one_sentence(config: Path) -> None:
    config.unlink()
    config.mkdir()
    with pytest.raises(ConfigError, match=f"^{config}: file: found “Is a directory”, expected a"):
        profile_of(case())


@pytest.mark.usefixtures("config")
def test_a_command_of_the_case_needs_the_consent_of_the_user() -> None:
    stated = case(command=["/opt/bar", "-q"])
    with pytest.raises(ConsentError, match="solver.profiles.bar.command: found a command that"):
        profile_of(stated)
    agree(requests_of_profiles(stated))
    assert profile_of(stated).command == ("/opt/bar", "-q")


@pytest.mark.usefixtures("config")
def test_a_command_of_another_solver_is_not_called_and_asks_nothing() -> None:
    stated = case(command=["/opt/bar"])
    other = stated.solver.model_copy(update={"name": "other"})
    assert profile_of(stated.model_copy(update={"solver": other})).threads == 3

"""How the program of a solver is called: what the case says over what the user's config says."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from driver.case.consent import Request, refuse_unless_agreed
from driver.case.messages import sentences
from driver.case.model import Case
from driver.case.solver import ProfileTable
from driver.case.toml import read_toml
from driver.case.values import Table
from driver.common.errors import InputError
from solver_adapters.profile import CONFIG_VARIABLE, Profile, config_path


class ConfigError(InputError):
    """A user's configuration that cannot be used: file, key, found, expected."""


class Config(Table):
    """The user's configuration, for all cases."""

    profiles: dict[str, ProfileTable] = Field(
        default_factory=dict, description="how the program of each solver is called"
    )


def load_config(path: Path, stated: bool) -> Config:
    """Read and validate the user's configuration.

    Args:
        path: the file.
        stated: whether somebody has named it; else there need not be one.

    Raises:
        ConfigError: the file is absent though it was named, cannot be read, is no TOML, or a key
            is wrong.
    """
    if not stated and not path.exists():
        return Config()
    data = read_toml(path, f"the file that {CONFIG_VARIABLE} names", ConfigError)
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise ConfigError(sentences(path, Config, data, error)) from None


def profile_of(case: Case, prepare_only: bool = False) -> Profile:
    """Return the profile of the solver of a case: its own entries, then the user's, then defaults.

    Files that a command names are sought from the folder of the file that states it.

    Raises:
        ConfigError: the user's configuration cannot be used.
        ConsentError: the case states a command to which the user has not agreed.
    """
    name = case.solver.name
    asked = [request for request in requests_of_profiles(case) if request.key == _command_key(name)]
    refuse_unless_agreed(case.file, asked)
    path = config_path()
    users = load_config(path, stated=bool(os.environ.get(CONFIG_VARIABLE))).profiles
    entries: dict[str, Any] = {}
    for folder, profiles in ((path.parent, users), (case.path(""), case.solver.profiles)):
        if name in profiles:
            entries |= profiles[name].model_dump(exclude_none=True)
            if (command := profiles[name].command) is not None:
                entries["command"] = with_files_of(folder, command)
    keys = {"memory_MB": "memory", "wall_time_s": "wall_time", "cpu_time_s": "cpu_time"}
    known = {keys.get(key, key): value for key, value in entries.items()}
    return Profile(**known, prepare_only=prepare_only, asker=os.path.abspath(case.file))


def requests_of_profiles(case: Case) -> list[Request]:
    """Return the commands of the profiles of a case, which its user has to agree to."""
    return [
        Request(_command_key(name), "a command", with_files_of(case.path(""), profile.command))
        for name, profile in case.solver.profiles.items()
        if profile.command is not None
    ]


def _command_key(solver: str) -> str:
    return f"solver.profiles.{solver}.command"


def with_files_of(folder: Path, command: Sequence[str]) -> tuple[str, ...]:
    """Return a call that can be made in any folder: its files by their absolute paths.

    A program without a slash is one of PATH, as in a shell.
    """
    program, *others = command
    sought = [program if "/" in program else "", *others]
    return tuple(
        os.path.abspath(folder / file) if os.path.isfile(folder / file) else word
        for word, file in zip(command, sought, strict=True)
    )

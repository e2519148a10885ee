"""The settings of a design, `prismid design --settings FILE`, and changes given on the way."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from pydantic import Field

from driver.case.toml import read_tables
from driver.case.values import Count, Number, Positive, Table
from driver.common.errors import InputError
from driver.virtual.settings import Face, Microscope, Program


class Schedule(Table):
    """How a test departs from the history of the case."""

    images_per_stop: Count = Field(
        default=1, description="a whole number, images and readings of the load at every stop"
    )
    stops: Count = Field(
        default=1, description="a whole number, stops with image and hold in the place of one"
    )
    holds: Positive = Field(default=1.0, description="a factor on the time of every hold")
    compression: bool = Field(
        default=False,
        description="true or false, a leg of compression as long as the last loading",
    )
    repeats: Count | None = Field(
        default=None, description="a whole number, images averaged into the reference"
    )
    exact_simulation: bool = Field(
        default=False, description="true or false, meshes and steps whose own error is nil"
    )


class Settings(Table):
    """What is assumed of an experiment that has not been made, and what it is compared with."""

    face: Face = Face()
    microscope: Microscope = Microscope()
    program: Program = Program()
    truth: dict[str, Number] = Field(
        default_factory=dict,
        description="assumed values of parameters of the general model, in internal units",
    )
    test: Schedule = Schedule()
    what_if: dict[str, dict[str, Any]] = Field(
        default_factory=dict,
        description="tables [what_if.NAME] of keys of the case, and of [what_if.NAME.test]",
    )


def read_settings(path: Path) -> Settings:
    """Read the settings of a design.

    Raises:
        InputError: the file is absent or no TOML, or a key is unknown or out of range.
    """
    return read_tables(path, Settings, "the settings of a design")


def read_change(text: str) -> dict[str, Any]:
    """Return a change of the command line: `loads.noise_uN = 2.0`, several of them parted by `;`.

    Raises:
        InputError: it is no TOML.
    """
    try:
        keys = tomllib.loads(text.replace(";", "\n"))
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            f'--change: found "{text}" ({error}), expected KEY=VALUE as in the case file, such as '
            '"loads.noise_uN=2", or "test.holds=3"'
        ) from None
    if not keys:
        raise InputError(f'--change: found "{text}", expected KEY=VALUE, as "loads.noise_uN=2"')
    return keys

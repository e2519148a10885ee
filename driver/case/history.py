"""Where the loading history is, and how its file is written."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.values import FileName, Positive, Table

Separator = Literal[",", ";", "\t", "|", " "]
TimeUnit = Literal["s", "ms", "min", "h", "hh:mm:ss"]


def with_micro_sign(unit: object) -> object:
    """Return a unit with the sign of micro where it has the Greek letter, which looks the same."""
    return unit.replace("\u03bc", "\u00b5") if isinstance(unit, str) else unit


LengthUnit = Annotated[Literal["um", "µm", "nm", "mm", "m"], BeforeValidator(with_micro_sign)]
ForceUnit = Annotated[Literal["N", "uN", "µN", "mN", "kN"], BeforeValidator(with_micro_sign)]
Row = Annotated[int, Field(strict=True, ge=1)]
ColumnName = Annotated[str, Field(min_length=1)] | Annotated[int, Field(strict=True, ge=1)]

SECONDS: dict[str, float] = {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
MICROMETRES: dict[str, float] = {"um": 1.0, "µm": 1.0, "nm": 1e-3, "mm": 1e3, "m": 1e6}
NEWTONS: dict[str, float] = {"N": 1.0, "uN": 1e-6, "µN": 1e-6, "mN": 1e-3, "kN": 1e3}
CLOCK = "hh:mm:ss"
"""The unit of a time that is no number."""


def _text_encoding(name: str) -> str:
    """Refuse what is no encoding of texts."""
    try:
        "a".encode(name)
    except (LookupError, UnicodeError, ValueError):
        raise refusal('an encoding, as "utf-8", "utf-16", "cp1252" or "latin-1"') from None
    return name


class ImageColumn(Table):
    """A column of the history that has no unit."""

    name: ColumnName = Field(description="a name in quotes, or the number of the column from 1 on")


class TimeColumn(ImageColumn):
    """The column of the times."""

    unit: TimeUnit = Field(description='"s", "ms", "min", "h" or "hh:mm:ss"')


class StageColumn(ImageColumn):
    """The column of the stage travel."""

    unit: LengthUnit = Field(description='"um", "nm", "mm" or "m"')


class ForceColumn(ImageColumn):
    """The column of the loads."""

    unit: ForceUnit = Field(description='"N", "uN", "mN" or "kN"')


class HistoryColumns(Table):
    """Names and units of the columns, where the file has others than prismid."""

    time: TimeColumn | None = Field(
        default=None, description='a table {name = …, unit = …}, default {"time_s", "s"}'
    )
    stage: StageColumn | None = Field(
        default=None, description='a table {name = …, unit = …}, default {"stage_um", "um"}'
    )
    image: ImageColumn | None = Field(
        default=None, description='a table {name = …}, default {"image"}'
    )
    force: ForceColumn | None = Field(
        default=None, description='a table {name = …, unit = …}, default {"force_N", "N"}'
    )


class HistoryTable(Table):
    """Where the loading history is, and how its file is written."""

    added: ClassVar[frozenset[str]] = frozenset(
        {"separator", "decimal", "encoding", "header_row", "first_row", "empty", "columns"}
    )

    file: FileName = Field(
        default="history.csv",
        description="a text in quotes, CSV of time_s, stage_um, image, force_N",
    )
    grip_distance_mm: Positive = Field(
        default=32.0, description="distance of the grips, over which the stage travels"
    )
    separator: Separator = Field(
        default=",", description="what parts the cells of a row; a blank stands for any of them"
    )
    decimal: Literal[".", ","] = Field(default=".", description="the decimal sign of numbers")
    encoding: Annotated[str, AfterValidator(_text_encoding)] = Field(
        default="utf-8", description="an encoding in quotes"
    )
    header_row: Annotated[int, Field(strict=True, ge=0)] = Field(
        default=1, description="the row with the names of the columns, 0 for none"
    )
    first_row: Row | None = Field(
        default=None, description="the first row of numbers, default the one after the names"
    )
    empty: str = Field(default="", description="what stands in a cell without a value")
    columns: HistoryColumns = HistoryColumns()

    @property
    def grip_distance(self) -> float:
        """Distance of the grips [µm]."""
        return self.grip_distance_mm * 1e3

    @property
    def time(self) -> TimeColumn:
        """Name and unit of the times."""
        return self.columns.time or TimeColumn(name="time_s", unit="s")

    @property
    def stage(self) -> StageColumn:
        """Name and unit of the stage travel."""
        return self.columns.stage or StageColumn(name="stage_um", unit="um")

    @property
    def image(self) -> ImageColumn:
        """Name of the numbers of the images."""
        return self.columns.image or ImageColumn(name="image")

    @property
    def force(self) -> ForceColumn:
        """Name and unit of the loads."""
        return self.columns.force or ForceColumn(name="force_N", unit="N")

    @property
    def first_data_row(self) -> int:
        """The first row of numbers, counted from 1."""
        return self.first_row or self.header_row + 1

    @model_validator(mode="after")
    def _no_cell_means_two_things(self) -> Self:
        if self.decimal == self.separator:
            raise refusal(
                'another one with decimal = ",", as ";"', "separator", f'"{self.separator}"'
            )
        names = [column.name for column in (self.time, self.stage, self.image, self.force)]
        for name in names:
            if names.count(name) > 1:
                found = f"{name} {names.count(name)} times"
                raise refusal("a column of its own for each", "columns", found)
        if self.first_row is not None and self.first_row <= self.header_row:
            expected = f"a row below the names of the columns, which stand in row {self.header_row}"
            raise refusal(expected, "first_row", str(self.first_row))
        return self

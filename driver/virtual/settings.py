"""The settings of a virtual experiment, `prismid virtual --settings FILE`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from driver.case.toml import read_tables
from driver.case.values import Count, NonNegative, Number, Positive, Table


class Face(Table):
    """What is on the face."""

    dot_height_nm: NonNegative = Field(default=20.0, description="height of the dots")
    dot_radius_um: Positive = Field(default=0.4, description="radius of the foot of a dot")
    dots_per_um2: NonNegative = Field(default=0.9, description="number of dots for each µm²")
    roughness_nm: NonNegative = Field(default=3.0, description="rms of the polish")
    slip_spacing_um: NonNegative = Field(
        default=0.0, description="distance of two slip planes, 0 for slip that is spread evenly"
    )


class Microscope(Table):
    """The instrument."""

    bits: Literal[8, 16, 32] = Field(default=8, description="8, 16 or 32 (float) bits a level")
    height_per_level_nm: Positive | None = Field(
        default=None,
        description="height of a level, default the case's (16 bits: 1/256 of it)",
    )
    noise_nm: NonNegative | None = Field(
        default=None, description="height noise, default that of the case"
    )
    noise_ratio: Annotated[float, Field(ge=1)] = Field(
        default=1.0,
        description="the noise at the last column over that at the first, its rms as stated",
    )
    pattern_nm: NonNegative = Field(default=8.0, description="rms of the fixed pattern")
    recentring_px: NonNegative = Field(
        default=0.3, description="largest error of the stage along X and Y"
    )
    refocusing_nm: NonNegative = Field(
        default=30.0, description="largest error of the stage along Z"
    )
    trench: bool = Field(default=True, description="true or false, a trench beside the face")
    rim_px: tuple[Count, Count] = Field(
        default=(6, 12), description="two whole numbers, pixels beyond the face along X and Y"
    )
    origin_error_px: NonNegative = Field(
        default=0.5, description="largest error of the stated origin along X and Y"
    )
    samples: Count = Field(
        default=1, description="points along each side of a pixel that it averages over"
    )
    resolution_nm: Positive = Field(
        default=50.0, description="standard deviation over which a slip step is rounded"
    )
    repeats: Annotated[int, Field(strict=True, ge=2)] = Field(
        default=10, description="images before loading"
    )
    flats: Annotated[int, Field(strict=True, ge=2)] = Field(
        default=100, description="images of a flat surface"
    )


class Program(Table):
    """What is done to the specimen; the history of the case where no cycles are given."""

    cycles: tuple[tuple[Count, Count], ...] = Field(
        default=(), description="a list of [images in loading, images in unloading]"
    )
    largest_strain: Positive = Field(
        default=0.015, description="elongation over length at the largest stage travel"
    )
    recovered_strain: NonNegative = Field(
        default=6e-4, description="elongation over length that an unloading gives back"
    )
    tilt_share: Number = Field(default=0.25, description="tilt of the ends over the elongation")


class Discretisation(Table):
    """How the truth is computed; finer than anything that identifies it."""

    mesh_size_um: Positive | None = Field(
        default=None,
        description="edge of the cells, hexahedra where the solver has them; default half of the "
        "finer mesh of the case, at most an eighth of the width",
    )
    steps_per_interval: Count | None = Field(
        default=None, description="time steps, default one more than in the finer simulation"
    )


class Virtual(Table):
    """A virtual experiment."""

    face: Face = Face()
    microscope: Microscope = Microscope()
    program: Program = Program()
    discretisation: Discretisation = Discretisation()
    truth: dict[str, Number] = Field(
        default_factory=dict,
        description="true values of parameters of the general model, in internal units",
    )


def read_virtual(path: Path) -> Virtual:
    """Read the settings of a virtual experiment.

    Raises:
        InputError: the file is absent or no TOML, or a key is unknown or out of range.
    """
    return read_tables(path, Virtual, "the settings of a virtual experiment")

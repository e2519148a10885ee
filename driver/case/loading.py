"""The loads and the motion of the end faces."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from driver.case.messages import refusal
from driver.case.values import Frame, NonNegative, Number, Positive, Table
from driver.parameters.instrument import LARGEST_LAG

_LARGEST_NOISE = 1e9
"""Of a load at the specimen [µN]: a thousand newtons, which no micro-prism carries."""


def _each_once(numbers: tuple[int, ...]) -> tuple[int, ...]:
    for number in numbers:
        if numbers.count(number) > 1:
            raise refusal("each number once", found=f"{number} {numbers.count(number)} times")
    return numbers


class Sections(Table):
    """The sections by which the macroscopic force is scaled to the specimen."""

    macroscopic_mm2: Positive = Field(default=3.0, description="section of the macroscopic sample")
    specimen_um2: Positive | None = Field(
        default=None, description="section of the prism, default drawn"
    )
    relative_uncertainty: Annotated[float, Field(strict=True, ge=0, le=1)] = Field(
        default=0.0, description="relative standard deviation of the ratio of the sections"
    )


class Loads(Table):
    """Noise of the loads, and what is known of their zero and of their clock."""

    noise_uN: Annotated[float, Field(strict=True, gt=0, le=_LARGEST_NOISE)] = Field(
        default=5.97, description="standard deviation at specimen scale"
    )
    autocorrelation: Annotated[float, Field(strict=True, ge=0, lt=1)] = Field(
        default=0.0, description="correlation of the noise from one image to the next"
    )
    offset_uncertainty_uN: Annotated[float, Field(strict=True, ge=0, le=_LARGEST_NOISE)] = Field(
        default=0.0, description="standard deviation of the zero of the load at the specimen"
    )
    clock_uncertainty_s: Annotated[float, Field(strict=True, ge=0, le=LARGEST_LAG / 3)] = Field(
        default=0.0, description="standard deviation of the lag of the load behind the images"
    )
    left_out: Annotated[tuple[Frame, ...], AfterValidator(_each_once)] = Field(
        default=(), description="a list of whole numbers, the images whose loads are wrong"
    )

    @property
    def gamma_F(self) -> float:
        """Standard deviation of the load at the specimen [µN]."""
        return self.noise_uN


class LambdaStart(Table):
    """Starts of the apex amplitudes λ."""

    plus_Y: Number = Field(default=1.0, description="apex of S+ along Y")
    plus_Z: Number = Field(default=1.0, description="apex of S+ along Z")
    minus_Y: Number = Field(default=1.0, description="apex of S− along Y")
    minus_Z: Number = Field(default=1.0, description="apex of S− along Z")


class Boundary(Table):
    """Motion of the end faces."""

    gauge: Literal["translation", "rigid"] = Field(
        default="translation", description="what is removed"
    )
    U_X: Literal["held", "free"] = Field(
        default="held", description="lateral motion of the end faces"
    )
    jitter_nm: NonNegative = Field(
        default=0.0, description="noise of the elongation at each stop, one standard deviation"
    )
    motion: Literal["images", "stage"] = Field(
        default="images", description="what the elongation is known from"
    )
    stage_ratio: Positive | None = Field(
        default=None, description='elongation over stage travel, for motion = "stage"'
    )
    stage_ratio_uncertainty: Positive | None = Field(
        default=None, description="standard deviation of stage_ratio, in each phase anew"
    )
    lambda_start: LambdaStart = LambdaStart()

    @property
    def jitter(self) -> float:
        """Noise of the elongation at each stop [µm]."""
        return 1e-3 * self.jitter_nm

    @model_validator(mode="after")
    def _ratio_of_the_stage(self) -> Self:
        for key in ("stage_ratio", "stage_ratio_uncertainty"):
            given = getattr(self, key)
            if self.motion == "stage" and given is None:
                raise refusal('a number > 0 with motion = "stage"', key)
            if self.motion == "images" and given is not None:
                raise refusal('nothing with motion = "images"', key, f"{given:g}")
        return self

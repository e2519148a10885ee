"""The loading history, the loads and the motion of the end faces."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from driver.case_tables.values import NonNegative, Number, Positive, Table


class HistoryTable(Table):
    """Where the loading history is."""

    file: str = Field(
        default="history.csv",
        description="a text in quotes, CSV of time_s, stage_um, image, force_N",
    )


class Sections(Table):
    """The sections by which the macroscopic force is scaled to the specimen."""

    macroscopic_mm2: Positive = Field(default=3.0, description="section of the macroscopic sample")
    specimen_um2: Positive | None = Field(
        default=None, description="section of the prism, default drawn"
    )
    relative_uncertainty: NonNegative = Field(
        default=0.0, description="relative standard deviation of the ratio of the sections"
    )


class Loads(Table):
    """Noise of the loads."""

    noise_uN: Positive = Field(default=5.97, description="standard deviation at specimen scale")
    autocorrelation: Annotated[float, Field(strict=True, ge=0, lt=1)] = Field(
        default=0.0, description="correlation of the noise from one image to the next"
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
    lambda_start: LambdaStart = LambdaStart()

    @property
    def jitter(self) -> float:
        """Noise of the elongation at each stop [µm]."""
        return 1e-3 * self.jitter_nm

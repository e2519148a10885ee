"""The height maps, and how they are correlated."""

from __future__ import annotations

from typing import Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from driver.case.instrument_files import LEVEL_NM, is_of_instrument
from driver.case.messages import refusal
from driver.case.values import Count, FileName, NonNegative, Number, Positive, Table
from driver.common.element_sizes import ELEMENT_UV, ELEMENT_W

Axis = Literal["+X", "-X", "+Y", "-Y"]
_AXES = {f"{sign}{name}": (1.0 if sign == "+" else -1.0) * np.eye(3)[axis]
         for axis, name in enumerate("XYZ") for sign in "+-"}  # fmt: skip


class Images(Table):
    """Where the height maps are, and how they lie on the specimen."""

    frames: FileName | None = Field(
        default=None,
        description="a text in quotes, the stack, pattern, folder or FILE.h5:/DATASET of the "
        'images; needed with boundary.motion = "images"',
    )
    flats: FileName | None = Field(default=None, description="images of a flat reference surface")
    repeats: FileName | None = Field(
        default=None,
        description="repeated images before loading; without them noise_nm has to be stated",
    )
    pixel_size_nm: Positive = Field(default=110.0, description="side of a pixel")
    height_per_level_nm: Positive = Field(default=6.5, description="height of one digital level")
    height_offset_nm: Number = Field(default=0.0, description="height of level 0")
    off_surface_level: Number | Literal["none"] = Field(
        default=0.0, description='the level of pixels without a height, or "none"'
    )
    origin_pixel: tuple[Number, Number] = Field(
        default=(35.5, 21.0),
        description="a list of two numbers [row, column], the pixel of X = 0, Y = 0",
    )
    origin_uncertainty_px: Positive = Field(
        default=0.5, description="standard deviation of the origin"
    )
    rows_along: Axis = Field(default="+X", description="specimen axis along which row numbers grow")
    columns_along: Axis = Field(default="+Y", description="specimen axis along which columns grow")
    heights: Literal["+Z", "-Z"] = Field(default="+Z", description="axis along which levels grow")
    mask: FileName | None = Field(
        default=None, description="an image that is 0 where pixels are not used"
    )
    noise_map: FileName | None = Field(
        default=None, description="an image of the noise of each pixel, on any scale above 0"
    )
    rim_px: NonNegative = Field(
        default=1.0, description="width of the rim inside the face that is not used, pixels"
    )
    dust: Literal["mask", "keep"] = Field(
        default="mask", description="what becomes of isolated spikes in the repeats"
    )
    noise_nm: Positive = Field(
        default=9.0,
        description="standard deviation of the height noise at a pixel: nominal, or without "
        "repeats the one that is used",
    )

    @property
    def pixel_um(self) -> float:
        """Side of a pixel [µm]."""
        return self.pixel_size_nm * 1e-3

    @property
    def level_um(self) -> float:
        """Height of one digital level [µm]."""
        return self.height_per_level_nm * 1e-3

    @property
    def offset_um(self) -> float:
        """Height of level 0 [µm]."""
        return self.height_offset_nm * 1e-3

    @property
    def gamma_f(self) -> float:
        """Nominal standard deviation of the height noise [µm]."""
        return self.noise_nm * 1e-3

    @model_validator(mode="before")
    @classmethod
    def _of_instrument(cls, stated: Any) -> Any:
        """Files of instruments have heights, and no level that marks pixels without one."""
        if isinstance(stated, dict) and is_of_instrument(stated.get("frames")):
            return {"height_per_level_nm": LEVEL_NM, "off_surface_level": "none"} | stated
        return stated

    @model_validator(mode="after")
    def _heights_of_instrument(self) -> Self:
        if is_of_instrument(self.frames) and self.height_per_level_nm != LEVEL_NM:
            raise refusal(
                f"nothing, or {LEVEL_NM:g}: the heights in {self.frames} are read in nanometres",
                "height_per_level_nm",
                f"{self.height_per_level_nm:g}",
            )
        return self

    @model_validator(mode="after")
    def _right_handed(self) -> Self:
        rows, columns, heights = (
            _AXES[axis] for axis in (self.rows_along, self.columns_along, self.heights)
        )
        if np.dot(np.cross(rows, columns), heights) <= 0:
            raise refusal(
                "a right-handed arrangement (rows × columns = heights, as +X, +Y, +Z; seen from "
                "above along +Y, +X is to the right); a left-handed one mirrors the crystal: where "
                "the file is stored the other way round, write its rows in the other order",
                "rows_along",
                f"rows {self.rows_along}, columns {self.columns_along}, heights {self.heights}",
            )
        return self


class Dic(Table):
    """Meshes and regularisation of the digital image correlation."""

    element_px: Count = Field(
        default=ELEMENT_UV, description="element of the in-plane motion, pixels"
    )
    height_element_px: Count = Field(
        default=ELEMENT_W, description="element of the height change, pixels"
    )
    mesh: FileName | None = Field(
        default=None,
        description='a text in quotes, a plane mesh file (.msh, .med, .vtu; µm) or "trace"',
    )
    height_mesh: FileName | None = Field(
        default=None,
        description='a text in quotes, a plane mesh file (.msh, .med, .vtu; µm) or "trace"',
    )
    penalty: Literal["tikhonov", "equilibrium_gap", "elastic"] = Field(
        default="tikhonov", description="what of the in-plane motion is regularised"
    )
    roughness_px: Positive | Literal["estimated", "none"] = Field(
        default="estimated",
        description='a number > 0 of pixels that the penalty grants, "estimated" or "none"',
    )
    travel_um: Positive | None = Field(
        default=None, description="a number > 0, stage travel below which changes are noise"
    )

    def roughness_um(self, pixel_um: float) -> float | Literal["estimated"]:
        """Return what the penalty grants [µm], infinity for none, for pixels of a size [µm]."""
        if self.roughness_px == "estimated":
            return "estimated"
        return np.inf if self.roughness_px == "none" else self.roughness_px * pixel_um

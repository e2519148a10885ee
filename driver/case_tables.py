"""The tables of the case file: units in the key names outside, µm, MPa, s, µN inside."""

from __future__ import annotations

from math import isfinite
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from driver.case_errors import refusal
from driver.errors import show
from solver_adapters.crystal import N_SYSTEMS
from solver_adapters.interaction import bcc24_classes
from solver_adapters.interface import Integration
from solver_adapters.material import MATERIAL_DECLARATIONS, Material

FloatArray = NDArray[np.float64]
Number = Annotated[float, Field(strict=True)]
Positive = Annotated[float, Field(strict=True, gt=0)]
NonNegative = Annotated[float, Field(strict=True, ge=0)]
Count = Annotated[int, Field(strict=True, ge=1)]
Vector = tuple[Number, Number, Number]
Axis = Literal["+X", "-X", "+Y", "-Y"]
_AXES = {f"{sign}{name}": (1.0 if sign == "+" else -1.0) * np.eye(3)[axis]
         for axis, name in enumerate("XYZ") for sign in "+-"}  # fmt: skip


def _known_parameters(names: tuple[str, ...]) -> tuple[str, ...]:
    known = [parameter.name for parameter in MATERIAL_DECLARATIONS]
    for name in names:
        if name not in known:
            raise refusal("one of " + ", ".join(known), found=f'"{name}"')
    if not names:
        raise refusal("at least one name of a material parameter")
    return names


Parameters = Annotated[tuple[str, ...], AfterValidator(_known_parameters)]


class Table(BaseModel):
    """A frozen table of the case file that refuses unknown keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Specimen(Table):
    """Geometry of the prism and of its grain boundary [µm], and the sizes of the two meshes."""

    length_um: Positive = Field(default=12.0, description="length along Y")
    width_um: Positive = Field(default=4.0, description="width of the measured face along X")
    depth_um: Positive | None = Field(
        default=None, description="depth along −Z, default width·√3/2"
    )
    mesh_size_um: Positive = Field(
        default=1.6, description="edge of the elements of the working mesh"
    )
    fine_mesh_size_um: Positive = Field(
        default=1.1, description="edge of the elements of the finer mesh"
    )
    boundary_point_um: Vector | None = Field(
        default=None, description="a list of three numbers [X, Y, Z], a point of the grain boundary"
    )
    boundary_normal: Vector | None = Field(
        default=None,
        description="a list of three numbers, the normal that points into the second grain",
    )

    @property
    def length(self) -> float:
        """Length along Y [µm]."""
        return self.length_um

    @property
    def width(self) -> float:
        """Width along X [µm]."""
        return self.width_um

    @property
    def mesh_size(self) -> float:
        """Edge of the elements of the working mesh [µm]."""
        return self.mesh_size_um

    @property
    def fine_mesh_size(self) -> float:
        """Edge of the elements of the finer mesh [µm]."""
        return self.fine_mesh_size_um

    @property
    def depth(self) -> float:
        """Depth of the apex below the measured face [µm]."""
        return self.depth_um if self.depth_um is not None else self.width_um * 3**0.5 / 2

    @property
    def area(self) -> float:
        """Area of the triangular section [µm²]."""
        return self.width * self.depth / 2

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.fine_mesh_size_um >= self.mesh_size_um:
            raise refusal(f"a number < mesh_size_um = {self.mesh_size_um:g}", "fine_mesh_size_um")
        if (self.boundary_point_um is None) != (self.boundary_normal is None):
            absent = "boundary_point_um" if self.boundary_point_um is None else "boundary_normal"
            raise refusal("a list of three numbers, as the other half of the boundary", absent)
        if self.boundary_normal is not None and not any(self.boundary_normal):
            raise refusal("a normal other than zero", "boundary_normal")
        return self


class Grain(Table):
    """A grain and its measured orientation."""

    name: str = Field(description="a text in quotes, the label of the grain")
    euler_deg: Vector = Field(
        description="a list of three numbers [φ1, Φ, φ2], Bunge, sample → crystal, in degrees"
    )


class Orientation(Table):
    """The rotation from the EBSD frame to the specimen frame."""

    ebsd_to_specimen: tuple[Vector, Vector, Vector] = Field(
        default=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        description="three rows of three numbers, x_specimen = matrix · x_EBSD",
    )

    @property
    def rotation(self) -> FloatArray:
        """The proper rotation nearest to the given matrix (it may be rounded), shape (3, 3)."""
        left, _, right = np.linalg.svd(np.array(self.ebsd_to_specimen))
        return np.asarray(left @ right, dtype=np.float64)

    @model_validator(mode="after")
    def _proper(self) -> Self:
        matrix = np.array(self.ebsd_to_specimen)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > 1e-3:
            raise refusal("a proper rotation: orthonormal rows (to 1e-3)", "ebsd_to_specimen")
        if np.linalg.det(matrix) < 0:
            raise refusal(
                "a proper rotation of determinant +1; this one has −1 and mirrors the crystal",
                "ebsd_to_specimen",
            )
        return self


_INTERACTION = f"{N_SYSTEMS} rows of {N_SYSTEMS} numbers, or the four numbers [H1, H2, H3, H4]"


def _matrix_or_classes(value: object) -> object:
    """Refuse what is neither 24 rows of 24 numbers nor the four classes of BCC24."""
    if value is None or _are_numbers(value, 4):
        return value
    if not isinstance(value, (list, tuple)) or not all(isinstance(r, (list, tuple)) for r in value):
        raise refusal(_INTERACTION)
    if len(value) != N_SYSTEMS:
        raise refusal(_INTERACTION, found=f"a list of {len(value)} rows")
    for place, row in enumerate(value, start=1):
        if not _are_numbers(row, N_SYSTEMS):
            raise refusal(_INTERACTION, found=f"row {place} as {show(row)}")
    return value


def _are_numbers(value: object, count: int) -> bool:
    """Whether a value is a list of so many finite numbers."""
    return (
        isinstance(value, (list, tuple))
        and len(value) == count
        and all(type(number) in (int, float) and isfinite(number) for number in value)
    )


Matrix = tuple[tuple[Number, ...], ...]
Classes = tuple[Number, Number, Number, Number]
Interaction = Annotated[Matrix | Classes | None, BeforeValidator(_matrix_or_classes)]


class MaterialTable(Table):
    """Constants of the crystal law, `solver_adapters.material.Material` with units in the names."""

    C11_GPa: Positive = Field(default=233.5, description="cubic elastic constant")
    C12_GPa: Positive = Field(default=135.5, description="cubic elastic constant")
    C44_GPa: Positive = Field(default=118.0, description="cubic elastic constant")
    K: Positive = Field(default=12.0, description="viscous stress in MPa·s^(1/n)")
    n: Positive = Field(default=10.0, description="rate exponent")
    tau0_MPa: Positive = Field(default=40.0, description="critical resolved shear stress")
    c_MPa: NonNegative = Field(default=40e3, description="kinematic modulus")
    d: NonNegative = Field(default=1500.0, description="recall of the back stress")
    Q_MPa: NonNegative = Field(default=0.0, description="saturated isotropic hardening")
    b: Positive = Field(default=30.0, description="rate of the isotropic hardening")
    h_latent: Number = Field(
        default=0.0, description="added to the interaction matrix off its diagonal"
    )
    interaction: Interaction = Field(default=None, description=_INTERACTION)
    tau0_112: Positive = Field(default=1.0, description="ratio of tau0 on {112} to {110}")
    tau0_grain2: Positive = Field(default=1.0, description="ratio of tau0 in grain 2 to grain 1")
    tau0_antitwinning: Positive = Field(
        default=1.0, description="ratio of tau0 on {112}, antitwinning to twinning sense"
    )
    a1: Number = Field(default=0.0, description="non-Schmid factor on {110}")
    c2_MPa: NonNegative = Field(default=0.0, description="modulus of a second back stress")
    d2: Positive = Field(default=150.0, description="recall of the second back stress")
    x0: Number = Field(default=0.0, description="initial back strain along the loading axis")
    eigenstrain: Number = Field(
        default=0.0, description="difference of axial eigenstrain between apex line and face"
    )
    skin_tau0: Positive = Field(default=1.0, description="ratio of tau0 at the surface to inside")
    skin_thickness_um: Positive = Field(default=0.3, description="depth over which it fades")
    elastic_scale: Positive = Field(default=1.0, description="factor on all elastic constants")
    C44_scale: Positive = Field(default=1.0, description="factor on C44 alone")
    strain_measure: Literal["small", "finite"] = Field(
        default="finite", description="strain measure"
    )

    @model_validator(mode="after")
    def _stable(self) -> Self:
        if self.C11_GPa <= self.C12_GPa:
            raise refusal(f"a number > C12_GPa = {self.C12_GPa:g} (a stable crystal)", "C11_GPa")
        if abs(self.x0) * self.d >= 1:
            raise refusal(f"a number smaller in size than 1/d = {1 / self.d:g}", "x0")
        return self

    def to_material(self) -> Material:
        """The constants in MPa and s."""
        return Material(
            C11=self.C11_GPa * 1e3, C12=self.C12_GPa * 1e3, C44=self.C44_GPa * 1e3,
            K=self.K, n=self.n, tau0=self.tau0_MPa, c=self.c_MPa, d=self.d, Q=self.Q_MPa,
            b=self.b, h_latent=self.h_latent, interaction=self._interaction_matrix(),
            tau0_112=self.tau0_112, tau0_grain2=self.tau0_grain2,
            tau0_antitwinning=self.tau0_antitwinning, a1=self.a1, c2=self.c2_MPa, d2=self.d2,
            x0=self.x0, eigenstrain=self.eigenstrain, skin_tau0=self.skin_tau0,
            skin_thickness=self.skin_thickness_um,
            elastic_scale=self.elastic_scale, C44_scale=self.C44_scale,
            strain_measure=self.strain_measure,
        )  # fmt: skip

    def _interaction_matrix(self) -> Matrix | None:
        if self.interaction is None or len(self.interaction) != 4:
            return self.interaction
        return tuple(tuple(row) for row in bcc24_classes(*self.interaction).tolist())


class Images(Table):
    """Where the height maps are, and how they lie on the specimen."""

    frames: str = Field(
        description="a text in quotes, the stack, pattern, folder or FILE.h5:/DATASET of the images"
    )
    flats: str | None = Field(default=None, description="images of a flat reference surface")
    repeats: str | None = Field(default=None, description="repeated images before loading")
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
    mask: str | None = Field(
        default=None, description="an image that is 0 where pixels are not used"
    )
    rim_px: NonNegative = Field(
        default=1.0, description="width of the rim inside the face that is not used, pixels"
    )
    dust: Literal["mask", "keep"] = Field(
        default="mask", description="what becomes of isolated spikes in the repeats"
    )
    noise_nm: Positive = Field(
        default=9.0, description="nominal standard deviation of the height noise"
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

    @model_validator(mode="after")
    def _right_handed(self) -> Self:
        rows, columns, heights = (
            _AXES[axis] for axis in (self.rows_along, self.columns_along, self.heights)
        )
        if np.dot(np.cross(rows, columns), heights) <= 0:
            raise refusal(
                "a right-handed arrangement (rows × columns = heights, as +X, +Y, +Z); "
                "a left-handed one mirrors the crystal",
                "rows_along",
                f"rows {self.rows_along}, columns {self.columns_along}, heights {self.heights}",
            )
        return self


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
    lambda_start: LambdaStart = LambdaStart()


class ProfileTable(Table):
    """How the program of a solver is called; what is not given here is asked elsewhere."""

    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None, description="a list of texts, the program and its leading arguments"
    )
    processes: Count | None = Field(default=None, description="MPI processes of a job")
    threads: Count | None = Field(default=None, description="threads of each process")
    memory_MB: Positive | None = Field(default=None, description="memory limit of a job")
    wall_time_s: Positive | None = Field(default=None, description="limit of the wall-clock time")
    cpu_time_s: Positive | None = Field(
        default=None, description="limit of the CPU time of all processes of a job together"
    )


class Solver(Table):
    """The solver and its time steps."""

    name: str = Field(
        default="bundled", description="a text in quotes, the name of a solver adapter"
    )
    integration: Integration | None = Field(
        default=None,
        description='"exponential" or "backward_euler", how the law is integrated over a time step',
    )
    steps_per_interval: Count = Field(
        default=1, description="time steps between two rows of the history"
    )
    fine_steps_per_interval: Count = Field(
        default=2, description="the same in the finer simulation"
    )
    accuracy_uN: Positive | None = Field(
        default=None,
        description="error of the force that a time step may make, by which steps are refined",
    )
    profiles: dict[str, ProfileTable] = Field(
        default_factory=dict, description="how the program of a solver is called, by its name"
    )


class Identification(Table):
    """Unknowns of the identification and their priors."""

    parameters: Parameters = Field(
        default=("tau0", "c", "d"),
        description="a list of names of material parameters",
    )
    prior_width: dict[str, Positive] = Field(
        default_factory=dict,
        description="standard deviation of the logarithm of a parameter, 1.0 where not given",
    )
    max_iterations: Count = Field(
        default=12, description="largest number of Gauss–Newton iterations"
    )

    def width(self, parameter: str) -> float:
        """Prior standard deviation of log(p/p0) [-]."""
        return self.prior_width.get(parameter, 1.0)

    @model_validator(mode="after")
    def _widths_of_parameters(self) -> Self:
        for name in self.prior_width:
            if name not in self.parameters:
                raise refusal(
                    "one of " + ", ".join(self.parameters), "prior_width", f'the name "{name}"'
                )
        return self


class DiagnosisTable(Table):
    """Which causes are tried and how."""

    causes: Literal["all"] | tuple[str, ...] = Field(
        default="all", description='"all" or a list of names of causes'
    )
    held_out_cycle: Literal["last", "none"] | Count = Field(
        default="last", description='"last", "none" or the number of a cycle'
    )
    refit: Count = Field(default=5, description="number of causes refitted nonlinearly")


class Dic(Table):
    """Element sizes of the digital image correlation."""

    element_px: Count = Field(default=16, description="element of the in-plane motion, pixels")
    height_element_px: Count = Field(default=8, description="element of the height change, pixels")


class Execution(Table):
    """Use of the machine."""

    processes: Count = Field(default=2, description="simulations side by side")
    threads: Count = Field(default=1, description="threads of each process")

"""The case: one frozen model of `case.toml`, read and checked at the border."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import reduce
from pathlib import Path
from typing import Any, Self, TypeVar
from unicodedata import normalize

from pydantic import BaseModel, Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from driver.case.grains import Grain, Orientation
from driver.case.history import HistoryTable
from driver.case.images import Dic, Images
from driver.case.inference import DiagnosisTable, Identification
from driver.case.loading import Boundary, Loads, Sections
from driver.case.material import COPPER, Crystal, MaterialTable
from driver.case.messages import refusal, sentences
from driver.case.solver import Execution, Solver
from driver.case.specimen import Shape, Specimen
from driver.case.toml import read_toml
from driver.case.user_mesh import measures_of_file
from driver.case.values import Number, Table
from driver.common.errors import InputError, one_of, sentence, why
from driver.parameters.boundary import LAMBDAS
from driver.parameters.microstructure import moves_boundary
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.registry import declared_parameters
from solver_adapters.material import of_other_crystals
from templates import render

AnyTable = TypeVar("AnyTable", bound=Table)


_MAPS = (".ang", ".ctf")  # names of EBSD maps that no image has
# Parameters that a single grain does not have, by the beginning of their names.
_OF_TWO_GRAINS = (
    "boundary_",
    "rotation_grain2",
    "rotation_frame",
    "lattice_gradient_grain2",
    "tau0_grain2",
)


CASE_FILE = "case.toml"
"""Name of the case file in the folder of a case."""
SCHEMA_FILE = "case.schema.json"
"""Name by which every case file knows its editor schema, which stands beside it."""


class CaseError(InputError):
    """A case file that cannot be used: one sentence a line, with file, key, found, expected."""


class Case(Table):
    """Everything that the user states about a specimen, its test and its analysis."""

    specimen: Specimen = Specimen()
    grains: tuple[Grain, ...] = Field(
        min_length=1, description="one or more tables [[grains]], along Y or against it"
    )
    orientation: Orientation = Orientation()
    material: MaterialTable = MaterialTable()
    images: Images = Images()
    history: HistoryTable = HistoryTable()
    sections: Sections = Sections()
    loads: Loads = Loads()
    boundary: Boundary = Boundary()
    solver: Solver = Solver()
    identification: Identification = Identification()
    diagnosis: DiagnosisTable = DiagnosisTable()
    extensions: dict[str, Number] = Field(
        default_factory=dict,
        description="starts of parameters of the general model that are freed beside the law",
    )
    dic: Dic = Dic()
    execution: Execution = Execution()

    _file: Path = PrivateAttr(default=Path(CASE_FILE))

    def model_post_init(self, context: Any) -> None:
        """Keep the case file, against whose folder its paths are resolved."""
        if context:
            self._file = context["file"]

    @property
    def file(self) -> Path:
        """The case file."""
        return self._file

    @model_validator(mode="after")
    def _mesh_of_its_own(self, info: ValidationInfo) -> Self:
        # Without the place of the case its files are not known.
        if not self.specimen.of_mesh or not info.context:
            return self
        assert self.specimen.mesh_file is not None
        path = info.context["file"].parent / self.specimen.mesh_file
        measures = measures_of_file(path, self.specimen, len(self.grains))
        return self.model_copy(update={"specimen": self.specimen.measured(measures)})

    @model_validator(mode="after")
    def _boundary_parts_the_grains(self) -> Self:
        if self.specimen.boundaries_stay:
            return self
        count, planes = len(self.grains), len(self.specimen.planes)
        if count == planes + 1:
            return self
        if self.specimen.boundaries:
            expected = f"{planes + 1}, for there are {planes} tables [[specimen.boundaries]]"
        elif planes:
            expected = "two tables [[grains]], for specimen.boundary_point_um is given"
            if count > 2:
                expected += f", or {count - 1} tables [[specimen.boundaries]] in its place"
        elif count == 2:
            expected = "one table [[grains]], or specimen.boundary_point_um and boundary_normal"
        else:
            expected = f"one table [[grains]], or {count - 1} tables [[specimen.boundaries]]"
        raise refusal(expected, "grains", f"{count} of them")

    @model_validator(mode="after")
    def _grains_of_different_names(self) -> Self:
        # As they are read: what differs by spaces or in how an accent is stored looks alike.
        names = [normalize("NFC", grain.name).strip() for grain in self.grains]
        for number, name in enumerate(names, 1):
            if name in names[: number - 1]:
                first = 1 + names.index(name)
                raise refusal(
                    f"a name of its own, for grains.{first} has it",
                    f"grains.{number}.name",
                    f'"{self.grains[number - 1].name}"',
                )
        return self

    @property
    def labelled_by_map(self) -> bool:
        """Whether the grains lie as in an EBSD map, in which each is picked."""
        return self.specimen.labels_point_um is not None

    @model_validator(mode="after")
    def _grains_of_the_map(self) -> Self:
        labels = self.specimen.labels
        if labels is None:
            return self
        of_map = [
            grain.ebsd is not None and Path(grain.ebsd) == Path(labels) for grain in self.grains
        ]
        if not any(of_map):
            if self.labelled_by_map or Path(labels).suffix.lower() in _MAPS:
                expected = "an image, or the EBSD map that all tables [[grains]] name in ebsd"
                raise refusal(expected, "specimen.labels", f'"{labels}", which none of them names')
            return self
        if not all(of_map):
            number = 1 + of_map.index(False)
            raise refusal(
                f'"{labels}" as specimen.labels, so that each grain of that map has its table',
                f"grains.{number}.ebsd",
            )
        if self.specimen.labels_pixel_nm is not None:
            raise refusal("nothing: the map has its step", "specimen.labels_pixel_nm")
        if not self.labelled_by_map:
            raise refusal(
                "a list of two numbers [x, y], where the map of specimen.labels has the middle of "
                "the edge Y = 0 of the face",
                "specimen.labels_point_um",
            )
        if self.orientation.ebsd_frame is None:
            raise refusal(
                '"edax", "oxford" or "bruker", so that ebsd_to_specimen is how the map of '
                "specimen.labels lies; angles of another setting take a label image",
                "orientation.ebsd_frame",
            )
        return self

    @model_validator(mode="after")
    def _ratios_of_grains(self) -> Self:
        ratios, later = len(self.material.tau0_grains), max(len(self.grains) - 2, 0)
        if ratios > later:
            raise refusal(
                f"at most {later}, one for each grain after the second",
                "material.tau0_grains",
                f"{ratios} ratios",
            )
        return self

    @model_validator(mode="after")
    def _identified_inside_bounds(self) -> Self:
        constants = self.material.to_material()
        declared = declared_parameters(1, constants)
        for name in self.identification.parameters:
            lower, upper, value = (
                declared[name].lower,
                declared[name].upper,
                getattr(constants, name),
            )
            if not lower <= value <= upper:
                raise refusal(
                    f"a start from {lower:g} to {upper:g}, for {name} is identified",
                    "material",
                    f"{name} = {value:g}",
                )
        return self

    @model_validator(mode="after")
    def _extensions_of_the_model(self) -> Self:
        n_grains = len(self.grains)
        law = self.material.to_material()
        declared = declared_parameters(1, law, n_grains=n_grains)
        always = (*LAMBDAS, *(parameter.name for parameter in POSE_DECLARATIONS))
        taken = {*always, *self.identification.parameters}
        known = [
            name
            for name in declared
            if name not in taken
            and (n_grains > 1 or not name.startswith(_OF_TWO_GRAINS))
            and name not in of_other_crystals(law.slip_systems)
        ]
        if self.specimen.boundaries_stay:
            known = [name for name in known if not moves_boundary(name)]
        for name, value in self.extensions.items():
            if self.specimen.boundaries_stay and moves_boundary(name):
                expected = "none of a grain boundary: those of mesh_file and labels stay"
                raise refusal(expected, "extensions", f'the name "{name}"')
            if name not in known:
                fitted = "a parameter that is not fitted in any case"
                expected = fitted if name in taken else one_of(name, known)
                raise refusal(expected, "extensions", f'the name "{name}"')
            lower, upper = declared[name].lower, declared[name].upper
            if not lower <= value <= upper:
                raise refusal(
                    f"a number from {lower:g} to {upper:g}", "extensions", f"{name} = {value:g}"
                )
        if "fixed_pattern" in self.extensions and self.images.flats is None:
            raise refusal(
                "images.flats as well, of whose pattern it is a share", "extensions",
                f"fixed_pattern = {self.extensions['fixed_pattern']:g}",
            )  # fmt: skip
        return self

    @model_validator(mode="after")
    def _images_where_they_are_used(self) -> Self:
        if self.with_images and self.images.frames is None:
            raise refusal(
                'a text in quotes, the images, for boundary.motion = "images"', "images.frames"
            )
        return self

    @model_validator(mode="after")
    def _a_stop_within_the_specimen(self) -> Self:
        jitter, length = self.boundary.jitter_nm, 1e3 * self.specimen.length
        if jitter >= length:
            expected = f"a number below the length of the specimen, {length:g} nm"
            raise refusal(expected, "boundary.jitter_nm", f"{jitter:g}")
        return self

    @model_validator(mode="after")
    def _nothing_that_loads_alone_ignore(self) -> Self:
        if self.with_images:
            return self
        identification, jitter = self.identification, self.boundary.jitter_nm
        alone = 'with boundary.motion = "stage"'
        if jitter:
            expected = f"0 {alone}: what the stage may be off is stage_ratio_uncertainty"
            raise refusal(expected, "boundary.jitter_nm", f"{jitter:g}")
        if identification.starts > 1:
            raise refusal(f"1 {alone}", "identification.starts", str(identification.starts))
        if identification.order == "paper":
            expected = f'"joint" {alone}: the paper\'s order holds knots that images measured'
            raise refusal(expected, "identification.order", '"paper"')
        if identification.prior == "none":
            expected = f'"gaussian" or "tikhonov" {alone}: loads do not see all of the λ\'s'
            raise refusal(expected, "identification.prior", '"none"')
        return self

    @property
    def with_images(self) -> bool:
        """Whether the motion comes from images; else it comes from the stage travel."""
        return self.boundary.motion == "images"

    def path(self, name: str) -> Path:
        """Return a path of the case file, relative to the folder of the case."""
        return self._file.parent / name

    def value_at(self, key: str) -> Any:
        """Return what stands at a dotted key of the case, as `boundary.lambda_start.plus_Y`."""
        return reduce(getattr, key.split("."), self)

    def with_values_at(self, values: Mapping[str, Any]) -> Case:
        """Return the case with other values at dotted keys, which are not validated anew.

        Raises:
            CaseError: there is no such key.
        """
        changed = self
        for key, value in values.items():
            if (unknown := _unknown(self, key)) is not None:
                raise CaseError(sentence(self.file, key, "no such key", unknown))
            changed = _with_value(changed, key, value)
        return changed

    @property
    def section(self) -> float:
        """Section of the specimen that scales the force [µm²]."""
        given = self.sections.specimen_um2
        return given if given is not None else self.specimen.area

    @property
    def force_scale(self) -> float:
        """Force at the specimen for a macroscopic newton [µN/N]: 2.31 for 4√3 µm² and 3 mm²."""
        return self.section / self.sections.macroscopic_mm2

    @property
    def mean_dilatation(self) -> bool:
        """Whether the dilatation of a cell is projected on few functions."""
        stated = self.solver.mean_dilatation
        return self.specimen.cell_kind == "hex20" if stated is None else stated


def _unknown(table: BaseModel, key: str) -> str | None:
    """Return what is expected at a dotted key that does not exist, None where it does."""
    name, _, below = key.partition(".")
    names = tuple(type(table).model_fields)
    if name not in names:
        return one_of(name, names)
    inner = getattr(table, name)
    if not below:
        return None
    return _unknown(inner, below) if isinstance(inner, BaseModel) else f"{name} as a whole"


def _with_value(table: AnyTable, key: str, value: Any) -> AnyTable:
    name, _, below = key.partition(".")
    changed = _with_value(getattr(table, name), below, value) if below else value
    return table.model_copy(update={name: changed})


def load_case(path: Path) -> Case:
    """Read and validate a case file.

    Raises:
        CaseError: the file is absent or no TOML, or a key is unknown, absent or out of range.
    """
    data = read_toml(path, "a case file (`prismid init DIR` writes one)", CaseError)
    try:
        return Case.model_validate(data, context={"file": path})
    except ValidationError as error:
        raise CaseError(sentences(path, Case, data, error)) from None


def case_text(case: Case) -> str:
    """Return the commented case file of a case; reading it back gives an equal case."""
    constants = type(case.material).model_fields
    comments = {key: constant.description for key, constant in constants.items()}
    return render("case.toml.j2", comments=comments, **case.model_dump(mode="json"))


def write_case(case: Case, path: Path | str) -> None:
    """Write a case file; its editor schema is expected beside it as `case.schema.json`."""
    try:
        Path(path).write_bytes(case_text(case).encode())
    except (OSError, ValueError) as error:
        expected = "a file that can be written, in a folder that is there"
        raise CaseError(sentence(Path(path), "file", why(error), expected)) from None


def default_case(crystal: Crystal = "bcc", shape: Shape = "prism") -> Case:
    """Return the case that `prismid init` writes: two grains, and the rest at its default.

    Args:
        crystal: whose slip systems and constants it has, those of a BCC steel or of copper.
        shape: of the specimen.

    Raises:
        InputError: an installed term of the user's own cannot be used.
    """
    declared_parameters(1)  # a validator would wrap what is said of a bad term
    plane = {"boundary_point_um": (0.0, 6.0, 0.0), "boundary_normal": (0.0, 1.0, 0.0)}
    return Case(
        specimen=Specimen(shape="mesh", mesh_file="specimen.msh")
        if shape == "mesh"
        else Specimen.model_validate({"shape": shape} | plane),
        grains=(
            Grain(name="grain 1", euler_deg=(0.0, 0.0, 0.0)),
            Grain(name="grain 2", euler_deg=(30.0, 0.0, 0.0)),
        ),
        material=COPPER if crystal == "fcc" else MaterialTable(slip_systems=crystal),
        images=Images(frames="images.tif", flats="flats.tif", repeats="repeats.tif"),
    )


def schema() -> dict[str, Any]:
    """JSON schema of the case file, for editors."""
    return Case.model_json_schema()


def schema_text() -> str:
    """Return the JSON schema as a text."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"

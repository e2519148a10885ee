"""The words that go along with an export: what its files hold."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from driver.results.hdf5 import prismid_version

_TITLE = "Results of prismid for other programs"

_FRAME = """\
Specimen frame: X across the width, Y along the loading axis, Z out of the measured face.
Coordinates are in µm; units of all else stand in the names.
"model" is the model as it was identified.
"""
_DIAGNOSED = """\
"extended" is the model with the causes that the diagnosis added (the same model fitted again,
where it added none).
"""
_NOT_DIAGNOSED = """\
There was no finished diagnosis of this case: `prismid run` makes one, and an export then holds
the extended model, too.
"""
_FILES = """\
surface.pvd       open this one in ParaView: the measured face over time [s], of the files below
surface/*.vtu     one file an image; points are the pixels of the region of interest, undeformed
  height_um               reference height of the surface
  motion_measured_um      u, v, w by free image correlation, moved rigidly onto the model (below)
  motion_model_um         u, v, w of the model, as the images would show it
  residual_model_nm       f + w − g(x + u) of the model: heights that it does not explain
  motion_extended_um, residual_extended_nm   the same of the extended model
mesh.vtu          working mesh of the simulation (quadratic cells), undeformed, cell field grain
loads.csv         an image a row: load measured at the specimen, loads of the models,
                  residual = measured − model [µN]
images.csv        an image a row: elongation and tilt of the face between its end edges [nm], chi of
                  free correlation (1 is noise), and the rigid motion between measurement and
                  model: shift [nm] and slopes ∂v/∂X, ∂w/∂X, ∂w/∂Y [µrad]
knots.csv         a turning point of the stage a row: elongation and tilt of the boundary motion,
                  with one standard deviation [nm]; empty where it is not a free parameter
parameters.csv    the other parameters: unit, start, value and one standard deviation

The stage re-centres and refocuses between the images, so that a rigid motion of each image is
unknown. What parts measurement and model rigidly (least squares over the pixels; a translation,
with boundary.gauge = "rigid" the slopes, too) is taken off motion_measured_um.
"""


_VOLUMES = """\

volume_model.vtkhdf, volume_extended.vtkhdf   the inside over time [s], in one file each: ParaView
                  5.12 or later. The mesh is undeformed (with the geometry of the model). Points:
  displacement_um         U_X, U_Y, U_Z since the first instant, without any shift of the stage
                  and cells (means over each):
  grain                   1, 2
  stress_MPa              Cauchy stress XX, YY, ZZ, XY, YZ, XZ
  slip                    signed slip of 24 or 48 systems since the start: of BCC 12 {110}, 12 {112}
  accumulated_slip        the same without signs; accumulated_slip_sum over all systems
  lattice_rotation_rad    rotation vector of the lattice since the start
"""
_MED = """\
volume_model.med, volume_extended.med   the same for Salome, with the groups of the mesh: DEPL [um]
                  at the nodes; STRESS [MPa], SLIP, ACCUMULATED_SLIP, ROTATION [rad] in the cells
"""


_LISTED = "Files of this export; the next one into this folder replaces or removes these alone:"


def write_readme(
    path: Path,
    case_path: Path,
    diagnosed: bool,
    volume: bool,
    med: bool,
    files: Sequence[Path],
) -> None:
    """Write what the files of an export are.

    Args:
        path: file to write.
        case_path: the case file.
        diagnosed: whether the extended model is there.
        volume: whether the fields of the volume are there.
        med: whether they are there as MED, too.
        files: every file of the export, relative to its folder.
    """
    case = f"{case_path.resolve().parent.name}/{case_path.name}"
    listed = "".join(f"  {file.as_posix()}\n" for file in sorted(files))
    made = datetime.now(UTC).isoformat(timespec="seconds")
    path.write_text(
        f"{_TITLE}\n\nCase {case}, prismid {prismid_version()}, {made}\n\n"
        f"{_FRAME}{_DIAGNOSED if diagnosed else _NOT_DIAGNOSED}\n"
        f"{_FILES}{_VOLUMES if volume else ''}{_MED if med else ''}"
        f"\n{_LISTED}\n{listed}",
        encoding="utf-8",
    )


def exported_files(path: Path) -> frozenset[Path]:
    """Read the files that such a text lists, relative to its folder; none of another text."""
    if not path.is_file():
        return frozenset()
    text = path.read_text(encoding="utf-8", errors="replace")
    title, _, rest = text.partition("\n")
    if title != _TITLE:
        return frozenset()
    listed = rest.partition(f"\n{_LISTED}\n")[2].splitlines()
    names = (Path(line.strip()) for line in listed if line.strip())
    # Anybody may have edited the text: nothing outside the folder is taken for an export.
    return frozenset(name for name in names if not name.is_absolute() and ".." not in name.parts)

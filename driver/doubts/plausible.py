"""Whether a test is one of a metal micro-specimen: what its numbers come to, and wrong units.

Limits are wide: beyond them it is a unit or a section that is wrong, not an unusual test.
"""

from __future__ import annotations

from collections.abc import Iterator

from driver.case.history import ForceColumn, StageColumn, TimeColumn
from driver.case.model import Case
from driver.common.formatting import number
from driver.doubts.finding import Finding
from driver.doubts.magnitudes import Magnitudes, magnitudes
from driver.experiment.history import History
from driver.experiment.log_columns import tells_unit
from driver.experiment.orientations import orientations_of
from driver.experiment.reading import fitted_loads
from meshes.arrays import FloatArray
from solver_adapters.constants import grain_ratios

# A tenth of the strain at which a metal yields, and a specimen that is half as long again.
_STRAINS = (1e-4, 0.5)
# Slower than creep that a test waits for, and faster than images between steps allow.
_RATES = (1e-8, 1.0)
# A height map takes seconds; after hours nobody waits for the next one.
_INTERVALS = (2.0, 2e4)
# An image sooner than a height map is taken with its hold, at a rate of no quasi-static test: where
# the file tells no unit, both are those of a log in minutes.
_SOON, _FAST = 20.0, 1e-4
# Below it no slip that the loads could tell; above it more than any micro-specimen bears.
_STRESSES = (1.0, 5000.0)
# The law begins to slip at one; at ten its hardening would be nine times its critical stress.
_SHEARS = (0.5, 10.0)
_ELASTIC = 3.0  # times the strain of the stage: stiffer than the crystal is


def in_figures(case: Case, history: History, force: FloatArray) -> Iterator[Finding]:
    """Yield what a test comes to, and what of it no metal micro-specimen does.

    Args:
        case: the case.
        history: its history.
        force: load at the specimen [µN], shape (n_images,).
    """
    of = sizes_of(case, history, force)
    yield Finding("ok", "in figures", _told(case, of))
    for message in _implausible(case, of):
        yield Finding("warning", "in figures", message)


def sizes_of(case: Case, history: History, force: FloatArray) -> Magnitudes:
    """Return the sizes of the test of a case.

    Args:
        case: the case.
        history: its history.
        force: load at the specimen [µN], shape (n_images,).
    """
    ratio, material = case.boundary.stage_ratio, case.material.to_material()
    nominal = 1.0 / case.history.grip_distance
    ratios = grain_ratios(material, len(case.grains))
    return magnitudes(
        history,
        fitted_loads(case, force),
        case.section,
        nominal if ratio is None else ratio / case.specimen.length,
        orientations_of(case),
        material.slip_systems,
        material.tau0 * ratios,
        (material.C11, material.C12, material.C44),
    )


def _told(case: Case, of: Magnitudes) -> str:
    grains = ", ".join(
        f"{grain.name} {factor:.2f}" for grain, factor in zip(case.grains, of.schmid, strict=True)
    )
    return (
        f"strain {number(100 * of.strain)} % by the stage, at {number(of.rate, 2)} /s while it "
        f"moves; {'an image' if case.with_images else 'a load'} every {number(of.interval)} s; "
        f"stress up to {number(of.stress)} MPa; largest Schmid factor along Y {grains}, which "
        f"makes {number(of.shear_ratio, 2)} tau0 of that stress; elastic strain "
        f"{number(100 * of.elastic, 2)} %"
    )


def _implausible(case: Case, of: Magnitudes) -> Iterator[str]:
    """Yield a sentence about each size that is out of all limits, with the key to look at."""
    yield from _strange_strain(case, of)
    yield from _strange_times(case, of)
    yield from _strange_stress(case, of)


def _strange_strain(case: Case, of: Magnitudes) -> Iterator[str]:
    column, (low, high) = case.history.stage, _STRAINS
    found = f"found {number(of.travel)} µm of travel, a strain of {number(100 * of.strain)} %"
    if case.with_images:
        place = "history.columns.stage"
        found = f"{found} with grips {case.history.grip_distance_mm:g} mm apart"
    else:
        place = "boundary.stage_ratio"
    if not low <= of.strain <= high:
        remedy = _remedy("stage", column, "mm" if of.strain < low else "nm")
        yield f"{place}: {found}, expected {100 * low:g} to {100 * high:g} %; {remedy}"
    elif of.elastic > _ELASTIC * of.strain and of.stress <= _STRESSES[1]:
        yield (
            f"{place}: {found}, expected at least {number(100 * of.elastic)} %, the elastic strain "
            f"at {number(of.stress)} MPa; look at the units of travel ({column.unit}) and load "
            f"({case.history.force.unit}), and at sections.macroscopic_mm2"
        )


def _strange_times(case: Case, of: Magnitudes) -> Iterator[str]:
    column, (low, high) = case.history.time, _INTERVALS
    # Loads alone may be logged as often as one likes.
    if case.with_images and not low <= of.interval <= high:
        remedy = _remedy("time", column, "min" if of.interval < low else "ms")
        yield (
            f"history.columns.time: found an image every {number(of.interval)} s, expected "
            f"{low:g} to {high:g} s; {remedy}"
        )
        return
    if (
        case.with_images
        and column.unit == "s"
        and of.interval < _SOON
        and of.rate > _FAST
        and not tells_unit(case.path(case.history.file), case.history, "time")
    ):
        yield (
            f"history.columns.time: found an image every {number(of.interval)} s and a strain rate "
            f"of {number(of.rate, 2)} /s, in a column whose unit the file does not tell; in min "
            f"they would be {number(of.interval)} min and {number(of.rate / 60, 2)} /s; "
            f"{_remedy('time', column, 'min')}"
        )
        return
    low, high = _RATES
    if not low <= of.rate <= high:
        yield (
            f"history.columns.time: found a strain rate of {number(of.rate, 2)} /s, expected "
            f"{low:g} to {high:g} /s; look at the units of time ({column.unit}) and travel "
            f"({case.history.stage.unit})"
        )


def _strange_stress(case: Case, of: Magnitudes) -> Iterator[str]:
    column, (low, high) = case.history.force, _STRESSES
    section = f"sections.macroscopic_mm2 = {case.sections.macroscopic_mm2:g}"
    if not low <= of.stress <= high:
        remedy = _remedy("force", column, "kN" if of.stress < low else "mN")
        yield (
            f"history.columns.force: found a stress of {number(of.stress)} MPa at the specimen, "
            f"expected {low:g} to {high:g} MPa: newtons of the macroscopic sample over {section}; "
            f"{remedy}"
        )
        return
    low, high = _SHEARS
    if not low <= of.shear_ratio <= high:
        yield (
            f"{section}: found a stress of {number(of.stress)} MPa, whose resolved shear stress is "
            f"{number(of.shear_ratio, 2)} times material.tau0_MPa = {case.material.tau0_MPa:g}, "
            f"expected {low:g} to {high:g} times; look at the section, at the unit of the loads "
            f"({column.unit}) and at tau0"
        )


def _remedy(kind: str, column: TimeColumn | StageColumn | ForceColumn, other: str) -> str:
    name = column.name if isinstance(column.name, str) else f"column {column.name}"
    return (
        f"if {name} is in {other}, not in {column.unit}, write {kind} = "
        f'{{name = …, unit = "{other}"}} under [history.columns]'
    )

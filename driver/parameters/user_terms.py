"""Terms of the boundary motion and of the load reading that other packages bring.

Every installed entry point of the group `prismid.terms` is a `BoundaryTerm` or a `ReadingTerm`.
Its parameter joins the general model: extensions free it, causes of one's own try it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from numbers import Real
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from driver.common.errors import InputError, why
from driver.parameters.boundary import knot_number
from meshes.arrays import FloatArray
from solver_adapters.parameter import Parameter

# Real or complex: derivatives are taken by complex steps through the formulas.
Field: TypeAlias = NDArray[np.inexact]
Term = TypeVar("Term")

GROUP = "prismid.terms"
_TINY = 1e-30  # complex step
_STEP = 1e-5  # of differences
_ALIKE = 1e-3  # of the largest value, within which both derivatives are the same
_INSTANTS = 60  # at which a formula is tried
_TEXTS = (("name", str, "a text"), ("unit", str, "a text"))
_NUMBERS = tuple((key, Real, "a number") for key in ("null", "scale", "lower", "upper"))


class TermError(InputError):
    """A formula that cannot be evaluated, named by its parameter."""

    def __init__(self, name: str, found: str, expected: str) -> None:
        """Say what was found of it, and what was expected."""
        super().__init__(f"{GROUP}: {name}: found {found}, expected {expected}")
        self.found, self.expected = found, expected


@dataclass(frozen=True, eq=False)
class EndFaces:
    """The nodes of both end faces, n, and how far the ends are apart at each of T instants.

    Attributes:
        side: +1 on S_PLUS, −1 on S_MINUS, shape (n,).
        zeta: −Z/depth, 0 on the edge and 1 at the apex, shape (n,).
        across: X/(width/2), shape (n,).
        stretch: elongation between the edges [µm], shape (T,).
        tilt: difference of U_Z between the edges [µm], shape (T,).
    """

    side: FloatArray
    zeta: FloatArray
    across: FloatArray
    stretch: Field
    tilt: Field


@dataclass(frozen=True)
class BoundaryTerm:
    """A motion that is added to that of the end faces, in proportion to its parameter.

    Attributes:
        parameter: its null is 0.
        motion: displacement of the nodes for a parameter of one [µm], shape (T, n, 3); a formula
            through which complex numbers go.
    """

    parameter: Parameter
    motion: Callable[[EndFaces], Field]

    def displacement(self, faces: EndFaces) -> Field:
        """Return the motion of these end faces [µm], shape (T, n, 3).

        Raises:
            TermError: the formula does not give it.
        """
        return _checked(self, (faces,), (len(faces.stretch), len(faces.side), 3))


@dataclass(frozen=True)
class ReadingTerm:
    """A load that is added to the reading, in proportion to its parameter.

    Attributes:
        parameter: its null is 0.
        reading: load [µN] for a parameter of one, shape (T,), from the force that the specimen
            carries [µN] and from the progress of the test (0 to 1), each of shape (T,); a formula
            through which complex forces go.
    """

    parameter: Parameter
    reading: Callable[[Field, FloatArray], Field]

    def load(self, force: Field, progress: FloatArray) -> Field:
        """Return what is added to the reading of this force [µN], shape (T,).

        Raises:
            TermError: the formula does not give it.
        """
        return _checked(self, (force, progress), progress.shape)


@lru_cache(maxsize=1)
def installed_terms() -> tuple[BoundaryTerm | ReadingTerm, ...]:
    """All terms that installed packages bring, by the name of their entry points.

    Raises:
        InputError: an entry point cannot be loaded or is no term; its parameter has another null
            than 0, or its formula another shape, or none through which complex numbers go.
    """
    return tuple(_load(point) for point in sorted(entry_points(group=GROUP), key=_name))


def files_of_terms(parameters: Iterable[str]) -> tuple[Path, ...]:
    """Return the files of the modules of the installed terms that have one of these parameters."""
    wanted = set(parameters)
    points = sorted(entry_points(group=GROUP), key=_name)
    terms = zip(points, installed_terms(), strict=True)
    modules = sorted({point.module for point, term in terms if term.parameter.name in wanted})
    origins = (spec.origin for module in modules if (spec := find_spec(module)) is not None)
    return tuple(Path(origin) for origin in origins if origin is not None)


def terms_of(kind: type[Term]) -> tuple[Term, ...]:
    """Return the installed terms of a kind."""
    return tuple(term for term in installed_terms() if isinstance(term, kind))


def declaration(term: BoundaryTerm | ReadingTerm) -> Parameter:
    """Return the parameter of a term with the place where terms of its kind enter."""
    return replace(term.parameter, enters="ends" if isinstance(term, BoundaryTerm) else "load")


def refuse_doubles(parameters: Sequence[Parameter]) -> None:
    """Refuse a term whose parameter has the name of another one.

    Raises:
        InputError: naming it.
    """
    names = [parameter.name for parameter in parameters]
    for term in installed_terms():
        if names.count(term.parameter.name) > 1:
            raise InputError(
                f'{GROUP}: found a second parameter "{term.parameter.name}", expected a name '
                "that the general model does not have"
            )


def _name(point: EntryPoint) -> str:
    return point.name


def _load(point: EntryPoint) -> BoundaryTerm | ReadingTerm:
    try:
        term = point.load()
    except (Exception, SystemExit) as error:  # whatever code raises as it is imported
        raise _refused(point, why(error), "an entry point that can be loaded") from None
    if not isinstance(term, BoundaryTerm | ReadingTerm):
        raise _refused(point, type(term).__name__, "a BoundaryTerm or a ReadingTerm")
    _check_parameter(point, term.parameter)
    _check_formula(point, term)
    return term


def _refused(point: EntryPoint, found: str, expected: str) -> InputError:
    return InputError(f"{GROUP}: {point.name}: found {found}, expected {expected}")


def _check_parameter(point: EntryPoint, parameter: Parameter) -> None:
    """Refuse a parameter that cannot be freed about a null of 0."""
    if not isinstance(parameter, Parameter):
        raise _refused(point, f"a parameter of the type {type(parameter).__name__}", "a Parameter")
    for key, kind, what in (*_TEXTS, *_NUMBERS):
        if not isinstance(value := getattr(parameter, key), kind) or isinstance(value, bool):
            raise _refused(point, f"the {key} {value!r} of its parameter", what)
    knot = knot_number(parameter.name) is not None
    if knot or not re.fullmatch(r"[A-Za-z]\w*", parameter.name):
        expected = "letters, digits and _ that name no knot"
        raise _refused(point, f'the name "{parameter.name}" of its parameter', expected)
    if parameter.null != 0:
        raise _refused(point, f"the null {parameter.null:g} of its parameter", "0")
    if parameter.logarithmic:
        raise _refused(point, "a logarithmic parameter", "one whose null is 0")
    if not 0 < parameter.scale < np.inf:
        raise _refused(point, f"the scale {parameter.scale:g} of its parameter", "a number > 0")
    if not parameter.lower < 0 < parameter.upper:
        bounds = f"the bounds {parameter.lower:g} and {parameter.upper:g} of its parameter"
        raise _refused(point, bounds, "0 between them")


def _check_formula(point: EntryPoint, term: BoundaryTerm | ReadingTerm) -> None:
    """Refuse a formula of the wrong shape, or one that complex numbers do not go through.

    It is tried on invented ends and loads: a derivative by a complex step against differences.
    """
    values = []
    for step in (0.0, _STEP, -_STEP, 1j * _TINY):
        try:
            values.append(_tried(term, 1.0 + step))
        except TermError as error:
            raise _refused(point, error.found, error.expected) from None
    slope = np.real(values[1] - values[2]) / (2 * _STEP)
    exact = np.imag(values[3]) / _TINY
    size = max(float(np.abs(slope).max()), float(np.abs(values[0]).max()))
    if np.abs(exact - slope).max() > _ALIKE * size:
        found = f"a {_kind(term)} whose derivative is lost with complex numbers"
        raise _refused(point, found, "a formula through which they go (no abs, no real part)")


def _tried(term: BoundaryTerm | ReadingTerm, factor: complex) -> Field:
    """Of ends and loads that are invented, the unloaded instant among them."""
    progress = np.linspace(0.0, 1.0, _INSTANTS)
    if isinstance(term, ReadingTerm):
        return term.load(730.0 * np.sqrt(progress) * factor, progress)
    side, zeta = np.array([1.0, 1.0, -1.0, -1.0]), np.array([0.0, 1.0, 0.0, 1.0])
    across = np.array([0.9, 0.0, -0.8, 0.0])
    stretch, tilt = 0.11 * np.sin(4.0 * progress), 0.019 * progress
    faces = EndFaces(side, zeta, across, stretch * factor, tilt * factor)
    return term.displacement(faces)


def _unchangeable(argument: Any) -> Any:
    """Return a view that a formula cannot write to: others read the same numbers."""
    if not isinstance(argument, np.ndarray):
        return argument
    view = argument.view()
    view.flags.writeable = False
    return view


def _kind(term: BoundaryTerm | ReadingTerm) -> str:
    return "motion" if isinstance(term, BoundaryTerm) else "reading"


def _checked(
    term: BoundaryTerm | ReadingTerm, of: tuple[Any, ...], shape: tuple[int, ...]
) -> Field:
    """Return what a formula makes of its arguments.

    Raises:
        TermError: it raises anything, or what it returns is not finite or of another shape.
    """
    kind, name = _kind(term), term.parameter.name
    formula = term.motion if isinstance(term, BoundaryTerm) else term.reading
    try:
        value = np.asarray(formula(*map(_unchangeable, of)))
    except (Exception, SystemExit) as error:  # whatever the formula raises
        raise TermError(name, f"a {kind} that ends with {why(error)}", "a formula") from None
    if value.shape != shape:
        named = "(T, n, 3)" if kind == "motion" else "(T,)"
        found = f"a {kind} of shape {value.shape} in place of {shape}"
        raise TermError(name, found, f"one of shape {named}")
    if value.dtype.kind not in "iufc" or not np.isfinite(value).all():
        raise TermError(name, f"a {kind} that is not finite", "numbers")
    return value

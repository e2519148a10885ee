"""Terms of the boundary motion and of the load reading that other packages bring.

Every installed entry point of the group `prismid.terms` is a `BoundaryTerm` or a `ReadingTerm`.
Its parameter joins the general model: extensions free it, causes of one's own try it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import EntryPoint, entry_points
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from driver.errors import InputError
from solver_adapters.parameter import Parameter

FloatArray = NDArray[np.float64]
# Real or complex: derivatives are taken by complex steps through the formulas.
Field: TypeAlias = NDArray[np.inexact]
Term = TypeVar("Term")

GROUP = "prismid.terms"


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


@lru_cache(maxsize=1)
def installed_terms() -> tuple[BoundaryTerm | ReadingTerm, ...]:
    """All terms that installed packages bring, by the name of their entry points.

    Raises:
        InputError: an entry point is no term, or the null of its parameter is not 0.
    """
    return tuple(_load(point) for point in sorted(entry_points(group=GROUP), key=_name))


def terms_of(kind: type[Term]) -> tuple[Term, ...]:
    """The installed terms of a kind."""
    return tuple(term for term in installed_terms() if isinstance(term, kind))


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
    term = point.load()
    if not isinstance(term, BoundaryTerm | ReadingTerm):
        raise InputError(
            f"{GROUP}: {point.name}: found {type(term).__name__}, expected a BoundaryTerm or a "
            "ReadingTerm"
        )
    if term.parameter.null != 0:
        raise InputError(
            f"{GROUP}: {point.name}: found the null {term.parameter.null:g} of its parameter, "
            "expected 0"
        )
    return term

"""All parameters of the general model, and the label of each by its name."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from driver.parameters.boundary import BOUNDARY_DECLARATIONS, knot_declarations, knot_number
from driver.parameters.covariance import COVARIANCE_PARAMETERS
from driver.parameters.history import HOLD_DECLARATIONS
from driver.parameters.instrument import IMAGE_DECLARATIONS, LOAD_DECLARATIONS, PATTERN_DECLARATIONS
from driver.parameters.microstructure import (
    geometry_declarations,
    grains_that_bear,
    lattice_declarations,
    orientation_declarations,
)
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.user_terms import declaration, installed_terms, refuse_doubles
from solver_adapters.material import Material, declarations_at
from solver_adapters.parameter import Parameter

_OF_THE_PAPER = Material()


def declared_parameters(
    n_knots: int,
    material: Material = _OF_THE_PAPER,
    scales: Mapping[str, float] | None = None,
    n_grains: int = 2,
) -> dict[str, Parameter]:
    """Every parameter of the general model by name, with its scale at a material.

    Args:
        n_knots: turning points of the history.
        material: constants of the law.
        scales: other prior scales, by name, that measured files tell.
        n_grains: grains of the specimen; a single one has the parameters of two, some of which it
            cannot move.
    """
    n_grains = max(n_grains, 2)
    declared = (
        *declarations_at(material, n_grains),
        *BOUNDARY_DECLARATIONS,
        *knot_declarations(n_knots),
        *HOLD_DECLARATIONS,
        *geometry_declarations(n_grains),
        *orientation_declarations(n_grains),
        *lattice_declarations(n_grains),
        *LOAD_DECLARATIONS,
        *IMAGE_DECLARATIONS,
        *PATTERN_DECLARATIONS,
        *POSE_DECLARATIONS,
        *map(declaration, installed_terms()),
    )
    refuse_doubles(declared)
    known = {parameter.name: parameter for parameter in declared}
    told = {name: replace(known[name], scale=scale) for name, scale in (scales or {}).items()}
    return known | told


def declaration_of(name: str) -> Parameter | None:
    """Return the declaration of a parameter of the general model or of the covariance.

    None of a name that is declared no more: results may be older than the terms that are installed.
    """
    declared = declared_parameters((knot_number(name) or 0) + 1, n_grains=grains_that_bear(name))
    return declared.get(name) or COVARIANCE_PARAMETERS.get(name)


def label_of(name: str) -> str:
    """Return a parameter as it is written for a reader: by its label, or its name."""
    declared = declaration_of(name)
    return declared.title if declared else name


def short_label_of(name: str) -> str:
    """Return the same where there is little room."""
    declared = declaration_of(name)
    return declared.short_title if declared else name

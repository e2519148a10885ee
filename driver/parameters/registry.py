"""All parameters of the general model."""

from __future__ import annotations

from driver.parameters.boundary import BOUNDARY_DECLARATIONS, knot_declarations
from driver.parameters.history import HOLD_DECLARATIONS
from driver.parameters.instrument import IMAGE_DECLARATIONS, LOAD_DECLARATIONS, PATTERN_DECLARATIONS
from driver.parameters.microstructure import (
    GEOMETRY_DECLARATIONS,
    LATTICE_DECLARATIONS,
    ORIENTATION_DECLARATIONS,
)
from driver.parameters.pose import POSE_DECLARATIONS
from driver.parameters.user_terms import declaration, installed_terms, refuse_doubles
from solver_adapters.material import (
    Material,
    declarations_at,
)
from solver_adapters.parameter import Parameter

_OF_THE_PAPER = Material()


def declared_parameters(n_knots: int, material: Material = _OF_THE_PAPER) -> dict[str, Parameter]:
    """Every parameter of the general model by name, with its scale at a material."""
    declared = (
        *declarations_at(material),
        *BOUNDARY_DECLARATIONS,
        *knot_declarations(n_knots),
        *HOLD_DECLARATIONS,
        *GEOMETRY_DECLARATIONS,
        *ORIENTATION_DECLARATIONS,
        *LATTICE_DECLARATIONS,
        *LOAD_DECLARATIONS,
        *IMAGE_DECLARATIONS,
        *PATTERN_DECLARATIONS,
        *POSE_DECLARATIONS,
        *map(declaration, installed_terms()),
    )
    refuse_doubles(declared)
    return {parameter.name: parameter for parameter in declared}

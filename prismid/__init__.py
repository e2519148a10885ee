"""The Python face of prismid.

Cases are read, run, simulated and drawn; results are read as labelled arrays; plain arrays are
correlated; a point of a crystal is pulled. `docs/python.md` is the reference.

What it offers is loaded when it is asked for: the command line begins here, too.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from prismid.precedence import own_packages_first

if TYPE_CHECKING:
    from driver.case.model import Case, default_case, write_case
    from driver.common.errors import InputError
    from driver.common.progress import progress_to
    from driver.dic.correlation import Correlation, Options, correlate
    from driver.dic.incremental import IncrementalCorrelation, correlate_incrementally
    from driver.doubts.finding import Finding
    from driver.experiment.orientations import orientations_of
    from driver.results.hdf5 import read_hdf5
    from prismid.cases import changed, load_case, results_of
    from prismid.pictures import figures
    from prismid.results import read_results
    from prismid.simulations import simulate
    from prismid.stages import check, export_case, report, run
    from solver_adapters.bundled.material_point import (
        MaterialPointCurve,
        loaded_along,
        strain_path,
        uniaxial_stress,
    )
    from solver_adapters.crystal import bunge_matrix
    from solver_adapters.interface import PreparedError, SolverError
    from solver_adapters.material import Material

__all__ = [
    "Case",
    "Correlation",
    "Finding",
    "IncrementalCorrelation",
    "InputError",
    "Material",
    "MaterialPointCurve",
    "Options",
    "PreparedError",
    "SolverError",
    "bunge_matrix",
    "changed",
    "check",
    "correlate",
    "correlate_incrementally",
    "default_case",
    "export_case",
    "figures",
    "load_case",
    "loaded_along",
    "orientations_of",
    "progress_to",
    "read_hdf5",
    "read_results",
    "report",
    "results_of",
    "run",
    "simulate",
    "strain_path",
    "uniaxial_stress",
    "write_case",
]

_MODULES = {
    "Case": "driver.case.model",
    "Correlation": "driver.dic.correlation",
    "Finding": "driver.doubts.finding",
    "IncrementalCorrelation": "driver.dic.incremental",
    "InputError": "driver.common.errors",
    "Material": "solver_adapters.material",
    "MaterialPointCurve": "solver_adapters.bundled.material_point",
    "Options": "driver.dic.correlation",
    "PreparedError": "solver_adapters.interface",
    "SolverError": "solver_adapters.interface",
    "bunge_matrix": "solver_adapters.crystal",
    "changed": "prismid.cases",
    "check": "prismid.stages",
    "correlate": "driver.dic.correlation",
    "correlate_incrementally": "driver.dic.incremental",
    "default_case": "driver.case.model",
    "export_case": "prismid.stages",
    "figures": "prismid.pictures",
    "load_case": "prismid.cases",
    "loaded_along": "solver_adapters.bundled.material_point",
    "orientations_of": "driver.experiment.orientations",
    "progress_to": "driver.common.progress",
    "read_hdf5": "driver.results.hdf5",
    "read_results": "prismid.results",
    "report": "prismid.stages",
    "results_of": "prismid.cases",
    "run": "prismid.stages",
    "simulate": "prismid.simulations",
    "strain_path": "solver_adapters.bundled.material_point",
    "uniaxial_stress": "solver_adapters.bundled.material_point",
    "write_case": "driver.case.model",
}

own_packages_first()


def __getattr__(name: str) -> Any:
    """Load the module of a name that is offered."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})

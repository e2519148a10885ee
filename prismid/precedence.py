"""Whose modules `driver`, `meshes`, `solver_adapters` and `templates` are: those of prismid.

Python looks for modules in the folder of a script, or of a call, first: what a user keeps there
may have one of these names.
"""

from __future__ import annotations

import sys
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from pathlib import Path

PACKAGES = ("driver", "meshes", "solver_adapters", "templates")
"""What prismid is made of, beside itself."""
ROOT = Path(__file__).resolve().parents[1]
"""The folder in which they stand."""


def own_packages_first() -> None:
    """Let Python find the packages of prismid before others of their names.

    Only where one of them would not be found. Processes that start from this one inherit it.

    Raises:
        ImportError: a module of such a name has been imported already.
    """
    hidden = False
    for name in PACKAGES:
        if name in sys.modules:
            place = _place(sys.modules[name].__spec__)
            if place != ROOT / name:
                raise ImportError(
                    f"{name}: found {place or 'a module without a file'}, which is imported "
                    f"already, expected that of prismid in {ROOT}: give your own another name, or "
                    "import prismid before it"
                )
        else:
            hidden = hidden or _place(find_spec(name)) != ROOT / name
    if hidden:
        sys.path.insert(0, str(ROOT))


def _place(spec: ModuleSpec | None) -> Path | None:
    """Return the folder of a package, the file of a module that is none, None where is neither."""
    if spec is None or not spec.has_location or spec.origin is None:
        return None
    path = Path(spec.origin).resolve()
    return path.parent if path.name == "__init__.py" else path

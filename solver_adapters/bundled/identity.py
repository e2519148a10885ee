"""Which solver this is: a hash of all that its answer depends on beside the simulation."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from solver_adapters.kernels import PACKAGES, hash_of

# They compile, factor, solve, and do the rest.
LIBRARIES = ("numba", "cvxopt", "pymetis", "scipy", "numpy")
BESIDE = (
    *(
        f"solver_adapters/{name}.py"
        for name in ("constants", "crystal", "material", "kernels", "cholesky", "cholmod")
    ),
    *(f"meshes/{name}.py" for name in ("cells", "tet10", "hex20")),
)


def solver_hash(packages: Path = PACKAGES) -> str:
    """16 hexadecimal digits; `packages` is the folder that holds `solver_adapters` and `meshes`."""
    own = sorted((packages / "solver_adapters" / "bundled").rglob("*.py"))
    beside = (packages / name for name in BESIDE)
    return hash_of((*own, *beside), {name: version(name) for name in LIBRARIES})

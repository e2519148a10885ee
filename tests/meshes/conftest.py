"""The prism that most tests of meshes use: the reference grain boundary, a coarse mesh."""

import pytest

from meshes.grain_boundary import GrainBoundary
from meshes.prism import PrismGeometry, generate
from meshes.prism_mesh import PrismMesh


@pytest.fixture(scope="session")
def geometry() -> PrismGeometry:
    return PrismGeometry(boundaries=(GrainBoundary((0, 5.4, 0), (0.15, 1, 0.30)),))


@pytest.fixture(scope="session")
def mesh(geometry: PrismGeometry) -> PrismMesh:
    return generate(geometry, 1.65)

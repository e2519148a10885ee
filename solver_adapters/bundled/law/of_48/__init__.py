"""The kernels of `law` for crystals of more than 24 slip systems, compiled for 48.

This package has the modules of `law`: Python loads them once more under its name, where their
relative imports find this number and each other, and Numba compiles a second set of them. What they
import by absolute names does not follow the number and is shared.
"""

from pathlib import Path

from solver_adapters.crystal import SYSTEM_COUNTS

__path__ = [str(Path(__file__).parents[1])]
NS = SYSTEM_COUNTS[1]
"""Slip systems of a point, as `law.NS`."""

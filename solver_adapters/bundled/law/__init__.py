"""The crystal law at Gauss points, and its derivatives.

Kernels whose loops and layouts follow the number of slip systems take it from here as a constant,
and import each other by relative imports: `of_48` loads them once more with another number.
"""

from solver_adapters.crystal import SYSTEM_COUNTS

NS = SYSTEM_COUNTS[0]
"""Slip systems of a point; where a crystal has fewer, null ones that never slip follow them."""

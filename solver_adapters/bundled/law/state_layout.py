"""Layout of the state of a point in the kernels: `law.StateLayout` of their number of systems."""

from solver_adapters.bundled.law.law import StateLayout

from . import NS

_STATE = StateLayout(NS)
S_X = _STATE.x
S_OVER = _STATE.over
S_ACC = _STATE.accumulated
S_X2 = _STATE.x2
N_STATE = _STATE.size

"""Layout of the part of a point's workspace that belongs to its slip systems.

Everything of a point lives in one flat workspace with constant offsets, so that LLVM sees that
the rows do not overlap and vectorises the loops over systems. It does so where a loop does much:
a short body is unrolled first and then stays scalar, hence sums over systems in one loop each.
"""

from solver_adapters.bundled.law.law import N_LOCAL

from . import NS

# Rows of NS numbers each but where said.
SIGN = 0 * NS  # S_s
SLIP = 1 * NS  # Δp_s
X0 = 2 * NS  # x_s at the start of the step
OVER0 = 3 * NS  # signed overstress at the start of the step
ACC0 = 4 * NS  # p_s at the start of the step
TAU0 = 5 * NS  # initial critical resolved shear stress
ASYMMETRY = 6 * NS  # what slip of positive sign adds to it
RISE = 7 * NS  # what hardening and the other terms of the general law add to it
SLOPE = 8 * NS  # ∂RISE/∂Δp of the same system
SHIFT = 9 * NS  # further back stress of a system at rest
TAU = 10 * NS  # resolved shear stress
WEIGHT = 11 * NS  # −1/(∂residual/∂Δp at fixed τ), 0 where at rest
RESIDUAL = 12 * NS
XHAT = 13 * NS  # S_s x_s at the end of the step
VISCOUS = 14 * NS  # overstress v at the end of the step
FALL = 15 * NS  # r = ln(v⁰/v) where the overstress relaxes, else 0
D_TAU = 16 * NS  # change of τ
LOAD = 17 * NS  # S STEP, which loads the condensed system
EXPLICIT = 18 * NS  # scratch: what a change of elasticity makes of τ at fixed Δp
SIGNED = 19 * NS  # S Δp
WEIGHTED = 20 * NS  # weights times one mode of the Schmid tensors
STEP = 21 * NS  # change of the slips: weights times a residual
X20 = 22 * NS  # second back strain at the start of the step
X2HAT = 23 * NS  # S_s times the second back strain at the end of the step
OTHER = 24 * NS  # shear stress on the conjugate plane (non-Schmid)
SLIP0 = 25 * NS  # slip of the step at the overstress of its start
FALLEN = 26 * NS  # overstress at the end of a relaxation
FALL_SLOPE = 27 * NS  # −∂ ln Δp/∂r
LEFT = 28 * NS  # share of the back strain that the step leaves, for derivatives as the next five
RECALL = 29 * NS  # ∂(S x)/∂d
GROWTH = 30 * NS  # ∂(S x)/∂Δp
HISTORY = 31 * NS  # c ∂(S x)/∂x⁰
OVER_GAIN = 32 * NS  # ∂v/∂(S⁰ v⁰) at fixed Δp
UNHARDENED = 33 * NS  # e^(−b p)
LOG_RATIO = 34 * NS  # ln(Δp/SLIP0) of a system that begins to relax
AHEAD = 35 * NS  # residual after the change of τ at fixed Δp
LEFT2 = 36 * NS  # share of the second back strain that the step leaves
EXCESS = 37 * NS  # stress on a system at rest above its resistance
EASED = 38 * NS  # e^(−r)
EASED_RATE = 39 * NS  # e^(−(n − 1) r)
INTERACTION = 40 * NS  # h, NS × NS
COUPLED = INTERACTION + NS * NS  # −∂residual/∂Δp with its off-diagonal terms, then its factors
WEIGHTS = COUPLED + NS * NS  # its inverse, null for systems at rest
SENSE = WEIGHTS + NS * NS  # +1 where positive slip is in the twinning sense, −1 against it
BY_CONSTANT = SENSE + NS  # derivative of the residual by each constant at fixed Δp, N_LOCAL × NS
HAS_SECOND = BY_CONSTANT + N_LOCAL * NS  # 1 where the state carries a second back strain
N_SLIP_ROWS = HAS_SECOND + 1

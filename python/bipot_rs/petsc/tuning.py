"""Constants of this folder that were fitted, and the effect of half and of twice each."""

# Iterations of one linear system after which the method has stalled.
MOST_ITERATIONS = 400

# Contacts between bodies: share of slipping and open contacts, and iterations of one linear
# system, above which the hierarchy follows the statuses.
LOOSE_SHARE = 0.6
SLOW_ITERATIONS = 30

# Iterations that estimate the largest eigenvalue of the smoothed matrix, and the interval of
# Chebyshev polynomials relative to it: an estimate from below, and what a coarser grid does
# not see.
EIGENVALUE_ITERATIONS = 10
SMOOTHED_FROM, SMOOTHED_TO = 0.1, 1.1

# Relative shift of the diagonal where contact alone holds a body. While its contacts slide or
# are open, a rigid motion may have no energy, and a preconditioner would return rounding errors
# as large motions. As `linalg/amg/coarsest.rs`: the shift changes no solution.
LOOSE_BODY_SHIFT = 1e-6

# Parts of a graph may differ in size by this fraction of their mean; bisection by coordinates
# is exact to a node.
UNEQUAL_PARTS = 0.1
# Unknowns of a scene up to which a factor on the first rank replaces multigrid.
GATHERED_UNKNOWNS = 1000

"""The fitted constants of the discretisation error: benches/discretisation_error.py."""

# A solution is exact enough for a mesh if its residual contributes this share of the
# discretisation error. Half and twice: the solver works for half a digit more or less.
SHARE = 0.1
# Bounds of the tolerance that follows: above the first, statuses are unreliable; below the
# second, no time is saved. Half and twice: nothing changes on the set.
LOOSEST, TIGHTEST = 1e-2, 1e-10
# Solutions until the tolerance fits. Two are usual; half and twice change nothing.
ATTEMPTS = 4
# Two digits of the energy of the self-stress are enough: the iteration stops when the last
# `WINDOW` steps together gain less than the fraction `ENOUGH`. Half and twice of `ENOUGH`: the
# bound changes in its third digit; of `WINDOW`: some iterations more or less.
ENOUGH, WINDOW = 0.01, 8
# Limit of these iterations; it is not reached on the set.
MOST_ITERATIONS = 500

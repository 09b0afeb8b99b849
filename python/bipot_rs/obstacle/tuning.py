"""The fitted constants of rigid obstacles, on the shapes of tests/python/obstacle."""

# More turns than this in radians are probably degrees. Half and twice: only the number at
# which the message appears.
MOST_TURNS = 100
# Step of differences over the extent of the points: it balances truncation, step⁴, and
# rounding, ε/step. Half and twice: errors of gradients up to 16 times as large.
DIFFERENCE_STEP = 1e-3
# The step is reduced by the first factor until |∇d| = 1 holds to the second. Half and twice:
# more evaluations of the distance, or gradients with errors of 1e-9 more.
STEP_REDUCTION, FINE_GRADIENT = 1 / 8, 1e-9
# Largest distance of a foot over the distance of its point. Some obstacles give distances to
# first order only, such as a height profile; with a wrong sign the ratio is 2. Half: steep
# profiles are refused; twice: nothing more is found.
FOOT_OFF = 0.1
# Points located on a triangulated surface at once: some ten megabytes. Half and twice: half
# and twice the memory; the same result.
POINTS_AT_ONCE = 2**13

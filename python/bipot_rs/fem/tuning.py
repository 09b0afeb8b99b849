"""The fitted constants of finite-element models: what they were fitted on, and what they change.

They decide when a warning appears or which of two equal ways is taken; no result depends on
them beyond rounding. What is derived from rounding or theory stands beside its use.
"""

# --- Warnings before solving (checks/inspection.py): the shipped scenes and the tutorials,
# none of which may warn, and tests/python/fem/test_inspection.py, which must.

# Displacements above this fraction of the size of the model are not small. Half and twice:
# contacts count as out of reach at half and at twice the distance.
SMALL_DISPLACEMENT = 0.1
# Young's moduli in Pa are above the first number, those of metals in MPa in the range. Half
# and twice: nothing changes for solids, whose moduli differ by powers of ten.
LEAST_IN_PASCAL, RANGE_IN_MEGAPASCAL = 1e9, (1e4, 1e6)
# Parts in m are shorter than the first length, parts in mm longer than the second. Half and
# twice: bridges, or sub-millimetre parts, are warned of or not.
LONGEST_IN_METRES, SHORTEST_IN_MILLIMETRES = 10.0, 0.05
# Mean stresses above this fraction of Young's modulus cause strains that are not small. Half
# and twice: the warning comes at 2.5 % and at 10 % of strain.
LARGE_LOAD = 0.05

# --- Warnings after solving (checks/inspection.py): the same scenes, and test_review.py.

# Largest rotation [rad] and strain that count as small; the theory neglects terms of their
# order. Half and twice: the warning comes at errors of 2.5 % and of 10 %.
SMALL_ROTATION = 0.05
# With fewer nodes across a contact zone its pressure is inaccurate. Half and twice: a Hertz
# zone is warned of below two, and below eight nodes across.
NODES_ACROSS = 4.0

# --- Ways of computing.

# Nodes up to whose product all pairs are compared, which is faster than importing a tree
# (contact/meeting.py). Half and twice: some milliseconds of start-up.
ALL_PAIRS = 2**20
# A preferred degree of freedom becomes the dependent one of a relation if its coefficient is
# at least this part of the largest one (constraints/ties.py; tests of cyclic symmetries and
# rigid sets). Half and twice: other degrees of freedom are eliminated, with results that
# differ by rounding.
PREFERRED = 0.1

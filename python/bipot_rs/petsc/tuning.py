"""Constants of this folder that were fitted, and the effect of half and of twice each."""

# Parts of a graph may differ in size by this fraction of their mean; bisection by coordinates
# is exact to a node.
UNEQUAL_PARTS = 0.1
# Unknowns of a scene up to which a factor on the first rank replaces multigrid.
GATHERED_UNKNOWNS = 1000

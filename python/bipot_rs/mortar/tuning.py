"""The fitted constants of mortar integrals, on the pairs of tests/python/mortar."""

# Facets may touch if their normals are opposite to within 60°: the cosine of the normals.
# Half (75°) and twice (parallel only): corners of bodies get contacts on facets that cannot
# touch; curved surfaces with coarse facets lose contacts.
FACING = -0.5
# Covered fraction of a node's area below which it has no contact of its own. Half: pressures
# at rims oscillate; twice: the rim loses contacts. Constant pressures are exact with both.
JOINED = 0.05
# Mean square of dual functions above which they are not used on a facet. Half and twice:
# other facets at the rim take the functions N themselves, with the same patch test.
SWING = 10.0
# Number of Gauss points at a time; bounds the memory. Half and twice: half and twice the
# memory; the same bits.
POINTS_AT_ONCE = 2**18

"""The names of the methods, as in the API and its documentation."""

METHODS = (
    "auto",
    "newton",
    "gauss_seidel",
    "nesterov",
    "uzawa",
    "uzawa_two_projection",
    "return_mapping",
    "perturbed_lagrangian",
    "displacement_principle",
    "alternating_principles",
    "stress_principle",
    "minimising_sequence",
    "pivoting",
)

# These methods need supports: they refuse bodies that contact alone holds.
NEED_SUPPORTS = ("alternating_principles", "minimising_sequence", "pivoting")

WITHOUT_SUPPORTS = tuple(name for name in METHODS if name not in NEED_SUPPORTS)

# Keywords of `solve`: each engine, and each method.
EVERY_WAY: tuple[dict[str, str], ...] = (
    {"engine": "direct"},
    {"engine": "iterative"},
    *({"method": name} for name in METHODS),
)

"""The names of the methods, as API and documentation give them."""

METHODS = (
    "auto",
    "newton",
    "gauss_seidel",
    "nesterov",
    "uzawa",
    "uzawa_two_projection",
)

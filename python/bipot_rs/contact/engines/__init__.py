"""What solves the load steps of a `ContactProblem`: by factorisation, or iteratively."""

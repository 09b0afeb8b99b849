"""A scene that the ranks of mpirun solve together: agreements, shared nodes, the problem."""

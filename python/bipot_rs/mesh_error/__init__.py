"""What the mesh leaves of the answer: stresses in balance that `discretisation` needs."""

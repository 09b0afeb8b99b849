"""One elastic body: its mesh, material, stiffness, stress, springs and loads."""

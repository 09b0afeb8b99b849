"""Contact of surfaces whose meshes do not match, by weighted relative displacements."""

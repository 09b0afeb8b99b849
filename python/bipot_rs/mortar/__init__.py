"""Contact of surfaces with different meshes, by weighted relative displacements."""

"""Elastic bodies: meshes and where they come from, materials, stiffness, stress."""

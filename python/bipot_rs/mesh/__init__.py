"""Meshes: element types, boxes, readers of mesh files, and checks of a mesh."""

"""Surfaces that face one another: facets, closest points, pairs whose meshes differ."""

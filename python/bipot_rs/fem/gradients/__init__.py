"""Derivatives with respect to materials, springs, loads, nodes and obstacles."""

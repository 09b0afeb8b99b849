"""Archard wear over many cycles of a load path, with jumps over cycles."""

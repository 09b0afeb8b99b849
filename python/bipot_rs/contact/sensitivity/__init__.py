"""Derivatives of the solutions of contact problems, (28) to (30) of ``docs/theory.md``."""

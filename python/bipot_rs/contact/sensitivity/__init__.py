"""Derivatives of the solutions of contact problems, (33) to (35) of ``docs/theory.md``."""

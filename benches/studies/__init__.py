"""Stability studies: one parameter, its whole range, errors beside what rounding allows."""

"""Existence, enumeration and ranges of answers."""

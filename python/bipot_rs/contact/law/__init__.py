"""Coulomb's law on arrays: statuses, projection, frames and resultants."""

"""Stability studies: errors over the whole range of one parameter, and rounding bounds."""

"""The arrays of (1) and (2) of all bodies, contacts and supports."""

"""Parameter studies: their rows, tables and parts, and what solves one row."""

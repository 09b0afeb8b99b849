"""What a solver returns: solutions, results of load paths, their text, tables and states."""

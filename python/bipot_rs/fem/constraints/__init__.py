"""Linear relations between displacements: inclined supports, rigid sets, repetitions."""

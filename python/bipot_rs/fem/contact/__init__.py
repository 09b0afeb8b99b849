"""Where surfaces meet obstacles and each other: gaps, frames, areas and rows of B."""

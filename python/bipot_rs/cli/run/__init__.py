"""One run of a scene: from its file to its results."""

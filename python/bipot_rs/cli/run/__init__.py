"""One run, of a scene or of matrices in files, from its files to its results."""

"""The contact problem on arrays: problems, load paths, results, bounds and proofs.

It needs only NumPy and SciPy, and does not use meshes.
"""

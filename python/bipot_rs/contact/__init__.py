"""The contact problem on arrays: problems, load paths, results, bounds and proofs.

It needs NumPy and SciPy alone, and knows no mesh.
"""

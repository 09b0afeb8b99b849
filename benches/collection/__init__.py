"""Forty load paths of frictional contact in FCLIB files, with reference answers.

`write.generate` writes the collection, `checks.check` verifies the answers of a folder without
any solver, and `catalogue.PATHS` describes the paths by name. In the folder `benches`::

    python -m collection DIR
    python -m collection --check DIR
"""

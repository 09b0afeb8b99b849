"""The tables of a scene as pydantic models; `root.Scene` is the root.

Pydantic checks each table by itself, `consistency` checks them against each other. The
key `on` is ``"body.surface"``.
"""

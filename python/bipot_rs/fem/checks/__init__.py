"""Warnings before and after solving, a sentence each."""

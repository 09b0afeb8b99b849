"""Summaries of files: results, files for ParaView, scenes and meshes."""

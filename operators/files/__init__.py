"""Mesh and point files, read and written through Blender."""

"""The command line: `python -m sparse_surface`, and the same commands inside Blender."""

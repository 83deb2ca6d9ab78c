"""Blender's data in and out: meshes, points, attributes, results."""

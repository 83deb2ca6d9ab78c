"""Meshes too large for one piece: cut into blocks that are approximated by themselves, anywhere, and blended."""

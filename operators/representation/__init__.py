"""The representation that a result holds, and what is made of it: finer meshes, single patches, UV maps."""

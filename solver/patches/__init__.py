"""The cover of a mesh by overlapping patches, their planar domains and their blending weights."""

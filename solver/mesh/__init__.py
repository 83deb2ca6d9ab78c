"""Triangle meshes and the geometry on them: reading polygons, normals, closest points, sampling, clustering."""

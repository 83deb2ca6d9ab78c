"""Denoising: removing the noise of a scanned mesh while preserving its creases.

`denoise` runs four steps:

1. `noise_level`: how large the noise is, from the mesh itself; a clean mesh is left alone.
2. `normal_filter`: a bilateral filter makes the triangles' normals smooth enough to tell one side of a crease from the
   other.
3. `patch_growth` and `one_sided_patches`: small patches that no crease crosses, each as large as its surface stays a
   quadratic, fitted robustly to the noisy positions.
4. `vertex_update`: every vertex moves to where the patches around it meet.
"""

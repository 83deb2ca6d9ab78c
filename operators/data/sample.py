"""A scene to try everything on: a part with sharp edges, a noisy scan, and points; all made by formulas."""

from __future__ import annotations

import bmesh
import bpy
import numpy as np
from bpy.types import Object, Scene
from numpy.typing import NDArray

from .meshes import create_mesh, triangle_mesh

SAMPLE = "sparse_surface_sample"
"""Custom property of the scene."""

NOISE = 0.008
"""Standard deviation of the scan's noise; the part is about 2 wide."""

POINTS = 4000
SPACE, ACROSS = 2.6, (0.69, 0.73)
"""Between the middles of neighbours, who stand in a row across the direction of Blender's first view."""

_CUTS = np.array(
    [
        (1.0, 0.3, 0.2, 0.78), (-1.0, 0.2, -0.3, 0.80), (0.1, 1.0, -0.25, 0.76), (-0.2, -1.0, 0.2, 0.82),
        (0.2, -0.1, 1.0, 0.74), (0.0, 0.2, -1.0, 0.80), (0.8, 0.7, 0.6, 0.86), (-0.7, 0.5, 0.8, 0.90),
    ]
)  # fmt: skip
"""Planes that cut a ball: a normal, and the distance from the middle."""


def sample_scene() -> Scene:
    """Return the sample scene of this file, which is made where there is none; its first object is selected."""
    found = next((each for each in bpy.data.scenes if SAMPLE in each), None)
    if found is not None:
        return found
    scene = bpy.data.scenes.new("Sparse Surface Sample")
    scene[SAMPLE] = True
    for place, made in enumerate((_part("Sharp Part", 6), _noisy_scan(), _points())):
        made.location.xy = (SPACE * place * along for along in ACROSS)
        scene.collection.objects.link(made)
    layer = scene.view_layers[0]
    layer.objects.active = scene.collection.objects[0]
    layer.objects.active.select_set(True, view_layer=layer)
    return scene


def _part(name: str, subdivisions: int, noise: float = 0.0) -> Object:
    """A ball that planes cut, so that sharp edges run across its triangles in all directions."""
    directions, triangles = _ball(subdivisions)
    normals, distances = _CUTS[:, :3] / np.linalg.norm(_CUTS[:, :3], axis=1)[:, None], _CUTS[:, 3]
    along = np.maximum(directions @ normals.T, 1e-6)
    radius = np.minimum(1.0, (distances / along).min(axis=1))
    positions = directions * radius[:, None]
    positions += noise * np.random.default_rng(1).standard_normal(positions.shape)
    return bpy.data.objects.new(name, triangle_mesh(name, positions, triangles))


def _noisy_scan() -> Object:
    return _part("Noisy Scan", 5, NOISE)


def _points() -> Object:
    """Points on a ring, spread evenly."""
    draw = np.random.default_rng(2)
    around, across = draw.uniform(0.0, 2.0 * np.pi, (2, 2 * POINTS))
    kept = draw.uniform(0.0, 1.4, 2 * POINTS) < 1.0 + 0.4 * np.cos(across)
    around, across = around[kept][:POINTS], across[kept][:POINTS]
    radius = 0.75 + 0.3 * np.cos(across)
    positions = np.stack([radius * np.cos(around), radius * np.sin(around), 0.3 * np.sin(across)], axis=1)
    return bpy.data.objects.new("Points", create_mesh("Points", positions))


def _ball(subdivisions: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Unit vectors in all directions, (V, 3), and the triangles between them, (T, 3)."""
    ball = bmesh.new()
    try:
        bmesh.ops.create_icosphere(ball, subdivisions=subdivisions, radius=1.0)
        positions = np.array([vertex.co for vertex in ball.verts], dtype=np.float64)
        triangles = np.array([[vertex.index for vertex in face.verts] for face in ball.faces], dtype=np.int64)
    finally:
        ball.free()
    return positions / np.linalg.norm(positions, axis=1)[:, None], triangles

"""A coarse base mesh for a point cloud, made with Blender's own tools.

Balls at the points become a volume, the volume a mesh: a shell around the cloud.  Its outer side, or one side of it
where the cloud is open, is decimated to the wanted number of vertices and drawn to the points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import bpy
import numpy as np
from bpy.types import NodeTree, Object
from numpy.typing import NDArray

from ...solver.errors import InputError
from ...solver.reconstruction.base import checked_base, drawn_to_points
from ...solver.reconstruction.geometry import analyse
from ...solver.reconstruction.reconstruct import checked_points, refuse_flat
from ...solver.reconstruction.shell import has_cavity, is_open, one_side, outer_parts, unpinched, without_loose
from .meshes import read_mesh, triangle_mesh

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

REACHES = (2.0, 2.5, 3.0, 4.0, 6.0)
"""Radii of the balls that are tried until the shell closes, in spacings of the cloud."""

OPEN_REACH, FULL_REACH = 2.5, 3.0
"""Radii for an open cloud, and for one of few points, whose inside the balls fill."""

LARGEST_RADIUS = 0.5
"""Largest radius of a ball, in longest sides of the cloud."""

VOXELS = 2.0
"""Voxels to a ball's radius."""

DENSITY_THRESHOLD = 0.1
POINTS_A_VERTEX = 60
"""About the number of points for each vertex of the base in the paper's clouds."""

FEWEST, MOST = 12, 20_000
"""Vertices of a base whose size the user has not chosen."""

DECIMATIONS = 4
TOO_FEW = 0.7
"""Share of the wanted vertices below which a decimation is rejected."""

ATTEMPTS = 4
MORE = 0.25
"""Share by which the next attempt has more vertices, after a base that was not a manifold."""


@dataclass(frozen=True)
class Base:
    """A base mesh: positions (V, 3), triangles (T, 3), and whether it is closed."""

    vertices: Array
    triangles: Indices
    closed: bool


def make_base(points: NDArray[np.floating[Any]], count: int = 0) -> Base:
    """Make a base from points.

    Parameters
    ----------
    points
        (P, 3).
    count
        Wanted number of vertices; 0: one for every sixty points.

    Raises
    ------
    InputError
        When the points span no volume, or no manifold could be made around them.
    """
    checked = checked_points(points)
    refuse_flat(checked)
    middle = 0.5 * (checked.min(axis=0) + checked.max(axis=0))
    size = float(np.ptp(checked, axis=0).max())
    unit = (checked - middle) / size  # Blender computes in single precision
    count = count or int(np.clip(len(points) // POINTS_A_VERTEX, FEWEST, MOST))
    shell, voxel, closed = _shell(unit)
    for attempt in range(ATTEMPTS):
        try:
            mesh = checked_base(*_coarse(shell, voxel * attempt, closed, count * (1.0 + MORE * attempt)))
        except InputError:
            continue
        near = drawn_to_points(mesh, unit, np.ones(len(unit)))
        return Base(near.vertices * size + middle, near.triangles, closed)
    raise InputError("No base could be made from the points: choose a base mesh for them.")


def _shell(points: Array) -> tuple[tuple[Array, Indices], float, bool]:
    """One side of the shell around points, the size of its voxels, and whether it is closed."""
    spacing = analyse(points).spacing
    radii = np.minimum(np.array(REACHES) * spacing, LARGEST_RADIUS)
    for radius in radii:
        shell = _around_balls(points, radius)
        if has_cavity(*shell, radius):
            return outer_parts(*shell), radius / VOXELS, True
    border = is_open(points)
    radius = min((OPEN_REACH if border else FULL_REACH) * spacing, LARGEST_RADIUS)
    shell = _around_balls(points, radius)
    return one_side(*shell, points) if border else outer_parts(*shell), radius / VOXELS, not border


def _around_balls(points: Array, radius: float) -> tuple[Array, Indices]:
    """Mesh around balls of this radius at points (P, 3)."""
    with _node_group() as tree, _temporary_object(points, np.zeros((0, 3), dtype=np.int64)) as made:
        _make_nodes(tree, radius, radius / VOXELS)
        modifier = made.modifiers.new("Shell", "NODES")
        modifier.node_group = tree
        return _evaluated(made)


def _make_nodes(tree: NodeTree, radius: float, voxel: float) -> None:
    """Points to volume, volume to mesh."""
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    nodes = [
        tree.nodes.new(kind)
        for kind in (
            "NodeGroupInput",
            "GeometryNodeMeshToPoints",
            "GeometryNodePointsToVolume",
            "GeometryNodeVolumeToMesh",
            "NodeGroupOutput",
        )
    ]
    for one, other in pairwise(nodes):
        tree.links.new(one.outputs[0], other.inputs[0])
    _, _, to_volume, to_mesh, _ = nodes
    if hasattr(to_volume, "resolution_mode"):
        to_volume.resolution_mode = "VOXEL_SIZE"
    else:  # a socket since 5.0
        to_volume.inputs["Resolution Mode"].default_value = "Size"
    for name, value in {"Density": 1.0, "Voxel Size": voxel, "Radius": radius}.items():
        to_volume.inputs[name].default_value = value
    to_mesh.inputs["Threshold"].default_value = DENSITY_THRESHOLD


def _coarse(shell: tuple[Array, Indices], voxel: float, closed: bool, count: float) -> tuple[Array, Indices]:
    """About `count` vertices of a shell; a closed one is remeshed first, where `voxel` is not zero."""
    if closed:
        return _decimated(*_remeshed(*shell, voxel), count, DECIMATIONS)
    return _decimated(*shell, count, 1)


def _remeshed(vertices: Array, triangles: Indices, voxel: float) -> tuple[Array, Indices]:
    def remesh(made: Object) -> None:
        modifier = made.modifiers.new("Remesh", "REMESH")
        modifier.mode, modifier.voxel_size = "VOXEL", voxel

    return _modified(vertices, triangles, remesh) if voxel else (vertices, triangles)


def _decimated(vertices: Array, triangles: Indices, count: float, rounds: int) -> tuple[Array, Indices]:
    """Collapse edges until about `count` vertices are left; with more rounds small open meshes lose most faces."""
    for _ in range(rounds):
        if len(vertices) <= 1.02 * count:
            break
        ratio = count / len(vertices)

        def decimate(made: Object, ratio: float = ratio) -> None:
            modifier = made.modifiers.new("Decimate", "DECIMATE")
            modifier.decimate_type, modifier.ratio = "COLLAPSE", ratio

        fewer, left = _modified(vertices, triangles, decimate)
        if len(fewer) < TOO_FEW * count:
            break
        vertices, triangles = fewer, left
    return unpinched(*without_loose(vertices, triangles))


def _modified(vertices: Array, triangles: Indices, modify: Callable[[Object], None]) -> tuple[Array, Indices]:
    with _temporary_object(vertices, triangles) as made:
        modify(made)
        return _evaluated(made)


def _evaluated(made: Object) -> tuple[Array, Indices]:
    """Positions and triangles of an object after its modifiers."""
    evaluated = made.evaluated_get(bpy.context.evaluated_depsgraph_get())
    arrays = read_mesh(evaluated.to_mesh())
    evaluated.to_mesh_clear()
    return arrays.vertices.astype(np.float64), arrays.triangles.astype(np.int64)


@contextmanager
def _temporary_object(vertices: Array, triangles: Indices) -> Iterator[Object]:
    """An object of the scene, removed at the end."""
    mesh = triangle_mesh("Base", vertices, triangles)
    made = bpy.data.objects.new("Base", mesh)
    bpy.context.scene.collection.objects.link(made)
    try:
        yield made
    finally:
        bpy.data.objects.remove(made)
        bpy.data.meshes.remove(mesh)


@contextmanager
def _node_group() -> Iterator[NodeTree]:
    tree = bpy.data.node_groups.new("Base", "GeometryNodeTree")
    try:
        yield tree
    finally:
        bpy.data.node_groups.remove(tree)

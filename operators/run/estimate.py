"""Estimated patch count, run time and memory of a run."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple

import bpy
from bpy.types import Context, Mesh, Object

from ...solver.native.library import reason_for_numpy
from ...solver.patch_methods import METHODS
from ...solver.settings import Settings
from ..data.objects import find_object
from .status import redraw_progress

LARGE_MESH = 300_000
"""Vertices beyond which the user is warned."""

COVER_EFFICIENCY = 0.47, 0.3
"""Share of a centre's (k - 1)-ring that no other patch covers, a + b / k; measured on spheres and sheets."""

BORDER = 0.8
"""Part of the (k - 1) rings by which patches reach over each end of a sheet."""

CREASE_DEGREES, MOST_CREASES = 30.0, 0.15
"""Angle beyond which an edge is taken for part of a crease, and the share of edges beyond which they are noise."""

FEWEST_ON_CLOSED = 6
"""Patches on a closed mesh whose rings nearly reach around it."""

FEWEST_VERTICES = 19
"""Vertices within two rings where six edges meet; a mesh with fewer has only patches of one ring."""

SECONDS_PER_POINT, SECONDS_PER_BASE_POINT = 2.5e-4, 1.5e-4
"""For each point of a cloud: to reconstruct at the default settings, and to make the base."""

POINTS_PER_PATCH = 60

MEGABYTES_PER_THOUSAND_VERTICES = 4.0

KERNEL_SHARE = 0.4
"""Share of NumPy's time that a run takes with the compiled kernel; measured from 0.29 to 0.43."""

_seconds_per_work = 4.0e-7
"""Of a common desktop processor; replaced by what the last run took on this machine."""

_cloud_speed = 1.0
"""How many times as long as on that processor the last cloud took."""


class Estimate(NamedTuple):
    """What to expect of a run.

    Attributes
    ----------
    patches, seconds, gigabytes
        About how many patches, how long, and how much memory.
    at_least
        Whether a tolerance may ask for more patches and more time, which only the run can tell.
    """

    patches: int
    seconds: float
    gigabytes: float
    at_least: bool = False


def estimate(vertices: int, settings: Settings, *, closed: bool = True, creases: int = 0) -> Estimate:
    """Estimate a run on a mesh with this number of vertices, with a border or closed, and of edges along creases."""
    denoises_only = settings.denoise == "only"
    return Estimate(
        patches=0 if denoises_only else _patches(vertices, settings.ring, closed, creases),
        seconds=_work(vertices, settings) * _seconds_per_work,
        gigabytes=vertices * MEGABYTES_PER_THOUSAND_VERTICES * 1e-6,
        at_least=settings.tolerance > 0.0 and not denoises_only,
    )


def estimate_cloud(points: int, base_vertices: int = 0) -> Estimate:
    """Estimate a reconstruction at the default settings.

    Parameters
    ----------
    points
        How many there are.
    base_vertices
        Vertices of the chosen base, each with a patch; 0: a base is made.
    """
    seconds = SECONDS_PER_POINT + (0.0 if base_vertices else SECONDS_PER_BASE_POINT)
    return Estimate(
        patches=base_vertices or max(round(points / POINTS_PER_PATCH), 1),
        seconds=points * seconds * _cloud_speed,
        gigabytes=points * MEGABYTES_PER_THOUSAND_VERTICES * 1e-6,
    )


def estimate_meshes(chosen: Sequence[Object], context: Context) -> Estimate:
    """Estimate a run on mesh objects with the scene's settings; cheap enough for every redraw."""
    settings = context.scene.sparse_surface.to_settings()
    each = [
        estimate(
            vertex_count(one, context),
            settings,
            closed=seems_closed(one, context),
            creases=crease_count(one, context) if settings.creases == "auto" else 0,
        )
        for one in chosen
    ]
    return Estimate(
        sum(one.patches for one in each),
        sum(one.seconds for one in each),
        max((one.gigabytes for one in each), default=0.0),  # one object is solved after the other
        any(one.at_least for one in each),
    )


def crease_count(chosen: Object, context: Context) -> int:
    """Return about how many edges of a mesh object lie along creases, 0 until a timer has counted them."""
    mesh = _mesh(chosen, context)
    key = chosen.session_uid, len(mesh.vertices), len(mesh.edges), len(mesh.polygons)
    if key not in _creases and len(mesh.vertices) <= LARGE_MESH:
        _creases[key] = 0
        if not bpy.app.background:
            bpy.app.timers.register(partial(_count_creases, chosen.session_uid, key), first_interval=0.3)
    return _creases.get(key, 0)


_creases: dict[tuple[int, ...], int] = {}
"""Edges along creases by the object's session number and its mesh's numbers of vertices, edges and faces."""


def _count_creases(session_uid: int, key: tuple[int, ...]) -> None:
    found = find_object(session_uid)
    if found is not None and found.type == "MESH":
        meshes = import_module("..data.meshes", __package__)  # NumPy-heavy: drawing the panel must not load it
        count = meshes.sharp_turns(_mesh(found, bpy.context), CREASE_DEGREES)
        _creases[key] = count if count <= MOST_CREASES * key[2] else 0
        redraw_progress(bpy.context)


def coarse_meshes(chosen: Sequence[Object], context: Context) -> list[Object]:
    """Return the mesh objects that are too coarse to be approximated: every vertex would get a patch of its own."""
    return [one for one in chosen if vertex_count(one, context) < FEWEST_VERTICES]


def learn(report: Mapping[str, Any]) -> None:
    """Take the speed of this machine from the report of a run; runs of less than half a second say nothing."""
    global _seconds_per_work, _cloud_speed
    seconds = report["seconds"]["total"]
    if seconds <= 0.5:
        return
    if "points" in report["input"]:
        _cloud_speed = seconds / (report["input"]["points"] * SECONDS_PER_POINT)
    elif "tolerance" not in report:  # how many patches that took says nothing of the machine
        _seconds_per_work = seconds / _work(report["input"]["vertices"], Settings.from_dict(report["settings"]))


def vertex_count(chosen: Object, context: Context) -> int:
    """Return the number of vertices that will be read from a mesh object; cheap enough for every redraw.

    Modifiers count as last evaluated: drawing a panel must not evaluate anything.
    """
    return len(_mesh(chosen, context).vertices)


def point_count(chosen: Object | None, context: Context) -> int:
    """Return the number of points that will be read from an object to be reconstructed; as cheap."""
    depsgraph = context.view_layer.depsgraph
    if chosen is None or depsgraph is None:
        return 0
    data = chosen.evaluated_get(depsgraph).data if chosen.mode == "OBJECT" else chosen.data
    return len(data.points if chosen.type == "POINTCLOUD" else data.vertices)


def seems_closed(chosen: Object, context: Context) -> bool:
    """Whether the Euler number of a mesh object is that of a closed surface, not of a disk; as cheap."""
    mesh = _mesh(chosen, context)
    return (len(mesh.vertices) - len(mesh.edges) + len(mesh.polygons)) % 2 == 0


def _mesh(chosen: Object, context: Context) -> Mesh:
    depsgraph = context.view_layer.depsgraph
    if context.scene.sparse_surface.use_modifiers and depsgraph is not None and chosen.mode == "OBJECT":
        return chosen.evaluated_get(depsgraph).data
    return chosen.data


def _patches(vertices: int, ring: int, closed: bool, creases: int = 0) -> int:
    if ring == 1:
        return vertices
    if closed:  # a ring that reaches around the mesh is not a disk; smaller ones are taken, or parts of it
        ring = min(ring, int(math.sqrt(vertices / 3.0 + 0.25) - 0.5))
        if ring <= 1:
            return min(FEWEST_ON_CLOSED, vertices)
    # a sheet is covered as if it reached beyond its border
    covered = vertices if closed else (math.sqrt(vertices) + BORDER * (ring - 1)) ** 2
    # the surface is cut along creases, so each edge is one of a border on both sides, with half a patch beyond it
    covered += BORDER * (ring - 1) * creases
    patches = round(covered / (_efficiency(ring) * _inner(ring)))
    return min(max(patches, FEWEST_ON_CLOSED if closed else 1), vertices)


def _inner(ring: int) -> int:
    """Vertices of a (k - 1)-ring where six edges meet."""
    return 1 + 3 * ring * (ring - 1)


def _efficiency(ring: int) -> float:
    return COVER_EFFICIENCY[0] + COVER_EFFICIENCY[1] / ring


def _work(vertices: int, settings: Settings) -> float:
    """Floating-point work in arbitrary units: observations times functions times steps.

    Removing noise costs about as much as a default run by NumPy.
    """
    if settings.denoise == "only":
        return _work(vertices, Settings(solver="numpy"))
    if settings.denoise == "first":
        return _work(vertices, Settings(solver="numpy")) + _work(vertices, replace(settings, denoise="off"))
    overlap = _inner(settings.ring + 1) / (_efficiency(settings.ring) * _inner(settings.ring))
    domains = 0.5 + 0.5 * settings.channels  # measured: three domains take about twice as long as one
    steps = METHODS[settings.method].work(settings.iterations, settings.sweeps)
    functions = settings.sparsity * (1.0 + ((settings.degree + 1) * (settings.degree + 2) / 2) / 120)
    share = KERNEL_SHARE if reason_for_numpy(settings.resolved()) is None else 1.0
    return vertices * overlap * domains * steps * functions * share

"""What each command keeps of a scene in each file format: real runs, written into docs/formats.md.

    .venv/bin/python scripts/measure_formats.py           # the tables, between their marks in docs/formats.md
    .venv/bin/python scripts/measure_formats.py .ply .obj # rows of these endings, printed

A scene is written in a format, the command reads that file and writes another in the same format, and both are read
again.  So a layer that the format or Blender's reader and writer lose by themselves is not the command's loss.
"""

from __future__ import annotations

import contextlib
import io
import os
import sys
import tempfile
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Object
from sparse_surface.command_line.main import main as command_line
from sparse_surface.operators.data.attributes import read
from sparse_surface.operators.data.meshes import read_polygons
from sparse_surface.operators.files.formats import WRITABLE
from sparse_surface.operators.files.meshes import read_meshes, write_meshes

PAGE = Path(__file__).resolve().parent.parent / "docs" / "formats.md"
BEGIN, END = "<!-- measured by scripts/measure_formats.py -->", "<!-- end -->"
LAYERS = (
    "vertices", "names", "parents", "UV map", "colours", "materials", "vertex groups", "attributes", "sharp edges",
)  # fmt: skip
OF_POINTS = ("names", "colours")
"""What a surface can have from points."""

QUICK = ("--iterations", "2", "--sweeps", "0", "--workers", "1", "--quiet")
COMMANDS: dict[str, tuple[str, ...]] = {
    "approximate": ("approximate",),
    "denoise": ("approximate", "--denoise", "only"),
    "resample": ("approximate", "--resample", "2"),
    "reconstruct": ("reconstruct",),
}
SIZE = 12
RESULT = " Sparse Surface"
OWN = {"error", "error_color", "patch", "domain_stretch"}
NOT_IN_FILE, KEPT, LOST = "–", "yes", "no"


def make_scene() -> list[Object]:
    """Make two objects, one the parent of the other, with a layer of every kind each."""
    bpy.ops.wm.read_homefile(use_empty=True)
    root = bpy.data.objects.new("Root", None)
    root.location = (1.0, 2.0, 0.0)
    bpy.context.scene.collection.objects.link(root)
    body = _sheet("Body", root, 0.0)
    made = [body, _sheet("Lid", body, 1.5)]
    bpy.context.view_layer.update()
    return made


def _sheet(name: str, parent: Object, height: float) -> Object:
    n = SIZE
    points = [(i / n, j / n, 0.2 * np.sin(5.0 * i / n) * np.cos(3.0 * j / n)) for i in range(n) for j in range(n)]
    quads = [(k, k + n, k + n + 1, k + 1) for i in range(n - 1) for k in range(n * i, n * i + n - 1)]
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(points, [], quads)
    corners = read_polygons(mesh)[0]
    mesh.uv_layers.new(name="UVMap").uv.foreach_set("vector", np.array(points)[corners, :2].ravel())
    colour = mesh.color_attributes.new("Col", "BYTE_COLOR", "POINT")
    values = [[round(x, 2), round(y, 2), 0.5, 1.0] for x, y, _ in points]
    colour.data.foreach_set("color_srgb", np.array(values).ravel())
    mesh.attributes.new("heat", "FLOAT", "POINT").data.foreach_set("value", [x for x, _, _ in points])
    for number in (1, 2):
        mesh.materials.append(bpy.data.materials.get(f"Paint {number}") or bpy.data.materials.new(f"Paint {number}"))
    mesh.polygons.foreach_set("material_index", [k % 2 for k in range(len(quads))])
    for k in range(5):
        mesh.edges[3 * k].use_edge_sharp = True
    made = bpy.data.objects.new(name, mesh)
    made.vertex_groups.new(name="Held").add(list(range(n)), 0.5, "REPLACE")
    made.parent, made.location = parent, (0.0, 0.0, height)
    bpy.context.scene.collection.objects.link(made)
    return made


def describe(path: Path) -> dict[str, Any]:
    """Return what a file holds of each layer, in a form that can be compared; empty where it holds nothing of it."""
    objects = read_meshes(path)
    results = [each for each in objects if each.name.endswith(RESULT)]
    chosen = results or objects  # a .blend has the sources too
    meshes = [each.data for each in chosen]
    named = [each.name.removesuffix(RESULT) for each in chosen]
    own = [layer for mesh in meshes for layer in mesh.attributes if layer.name in ("heat", "_heat")]
    colours = [mesh.color_attributes[0] for mesh in meshes if _colours(mesh)]
    return {
        "vertices": sum(len(mesh.vertices) for mesh in meshes),
        "names": sorted(named) if {"Body", "Lid"} <= set(named) else [],
        "parents": sorted(_line(each) for each in chosen if each.parent is not None),
        "UV map": [_values(np.array([u.vector for u in layer.uv])) for mesh in meshes for layer in mesh.uv_layers[:1]],
        "colours": [_values(np.array([c.color_srgb for c in layer.data])) for layer in colours],
        "materials": sorted({m.name for mesh in meshes for m in mesh.materials if m and m.name.startswith("Paint")}),
        "vertex groups": sorted({group.name for each in chosen for group in each.vertex_groups}),
        "attributes": [_values(read(layer.id_data, layer.name)) for layer in own],
        "sharp edges": sum(edge.use_edge_sharp for mesh in meshes for edge in mesh.edges),
    }


def _colours(mesh: Any) -> bool:
    return bool(len(mesh.color_attributes)) and mesh.color_attributes[0].name not in OWN


def _line(each: Object) -> str:
    """Names from an object up to its root; a reader may make a mesh the child of an object of its name."""
    above = []
    parent = each.parent
    while parent is not None:
        above.append(parent.name.partition(".")[0].removesuffix(RESULT))
        parent = parent.parent
    return " ".join([each.name.removesuffix(RESULT).partition("_")[0], *above])


def _values(values: Any) -> list[float]:
    """Return what stays of values whatever their order and number: their quantiles."""
    return np.round(np.quantile(values, np.linspace(0.0, 1.0, 5), axis=0), 2).ravel().tolist()


def verdicts(ending: str, folder: Path, commands: Iterator[str] | tuple[str, ...]) -> dict[str, dict[str, str]]:
    """Run commands on the scene in a format; return what became of each layer."""
    given = folder / f"scene{ending}"
    write_meshes(given, make_scene(), "keep")
    before, found = describe(given), {}
    for command in commands:
        out = folder / f"{command}{ending}"
        words = [*COMMANDS[command], str(given), "-o", str(out), *QUICK]
        with contextlib.redirect_stderr(io.StringIO()) as said:
            code = command_line(words)
        if code:
            raise SystemExit(f"{command} {ending}: {said.getvalue()}")
        after = describe(out)
        found[command] = {layer: _verdict(layer, command, before, after) for layer in LAYERS}
    return found


def _verdict(layer: str, command: str, before: dict[str, Any], after: dict[str, Any]) -> str:
    if not before[layer]:
        return NOT_IN_FILE
    if layer == "vertices":
        same = after[layer] == before[layer]
        return KEPT if same else f"{after[layer]} of {before[layer]}" if command == "approximate" else LOST
    if command in ("resample", "reconstruct") and layer not in ("names", "parents", "materials", "vertex groups"):
        return KEPT if bool(after[layer]) else LOST  # other vertices have other values
    return KEPT if after[layer] == before[layer] else LOST


def row(ending: str, folder: Path) -> str:
    """Return the row of an ending: what all but `reconstruct` keep, or which of them, and what `reconstruct` does."""
    found = verdicts(ending, folder, tuple(COMMANDS))
    cells = []
    for layer in LAYERS:
        each = {command: found[command][layer] for command in ("approximate", "denoise", "resample")}
        if layer == "vertices":
            del each["resample"]  # finer by its nature
        said = set(each.values())
        keep = [command for command, verdict in each.items() if verdict == KEPT]
        cells.append(said.pop() if len(said) == 1 else ", ".join(keep) or LOST)
    rebuilt = [layer for layer in OF_POINTS if found["reconstruct"][layer] == KEPT]
    return f"| {' | '.join([ending, *cells, ', '.join(rebuilt) or 'points only'])} |"


def table(folder: Path) -> Iterator[str]:
    """Yield the lines of the table."""
    yield f"| ending | {' | '.join(LAYERS)} | `reconstruct` keeps |"
    yield "| --- " * (len(LAYERS) + 2) + "|"
    for ending in WRITABLE:
        yield row(ending, folder)
        print(ending, file=sys.stderr, flush=True)


def write_page(lines: list[str]) -> None:
    """Put the table between its marks."""
    text = PAGE.read_text(encoding="utf-8")
    head, _, rest = text.partition(BEGIN)
    _, _, tail = rest.partition(END)
    PAGE.write_text("\n".join([head + BEGIN, *lines, END + tail]), encoding="utf-8")


def main(endings: list[str]) -> None:
    """Measure all formats into the page, or print the rows of some."""
    with tempfile.TemporaryDirectory() as scratch:
        if endings:
            for ending in endings:
                print(row(ending, Path(scratch)))
        else:
            write_page(list(table(Path(scratch))))


if __name__ == "__main__":
    code = 1
    try:
        main(sys.argv[1:])
        code = 0
    except BaseException:  # also where a package is missing: see below
        traceback.print_exc()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)  # Blender's own way out may never end

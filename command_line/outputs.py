"""Files that the commands write: a table from which their arguments, early refusal and writing are made.

Names of Blender's modules are imported when a file is written: usage is checked, and help shown, without Blender.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..operators.files.formats import ONLY_PLAIN, WRITABLE, missing_library, up_axis
from ..solver.atomic_files import atomic_output
from .console import console

LONGEST_NAME = 255
"""Bytes that a file's name may have on every common system."""


@dataclass(frozen=True)
class Made:
    """A result with what it was made from: the file, objects in Blender, what the solver returned.

    `resolution` says into how many parts each edge is split before the result is written; None: it stays as it is.
    `measured` are distances between `result` and `source`.  `shown` is what pictures show of the result, if not itself.
    `part` says where the result is in a surface that it shares with others (`approximation.parts`).
    `error_colours` says which colours a mesh file has (`formats.ERROR_COLOURS`), `quality` and
    `vertex_order` what is kept of the representation (`formats.QUALITIES`, `formats.ORDERS`).
    """

    input: Path
    source: Any
    result: Any
    report: dict[str, Any]
    representation: Any
    resolution: int | None = None
    measured: Any = None
    shown: Any = None
    caption: str = "Sparse Surface"
    error_colours: str = "replace"
    quality: str = "exact"
    vertex_order: str = "keep"
    part: Any = None


def keeps_functions(options: argparse.Namespace) -> bool:
    """Whether objects need the functions of their surfaces: to be saved with them, or for what is made of them."""
    return bool(is_scene(options.output) or options.resample or options.domain_maps)


def is_scene(path: Path | None) -> bool:
    """Whether a file holds everything there is in Blender."""
    return path is not None and path.suffix.lower() == ".blend"


def asked_for(options: argparse.Namespace) -> dict[str, Any]:
    """Return what was asked for of files, as fields of `Made`."""
    return {
        "error_colours": options.error_colors,
        "quality": options.quality,
        "vertex_order": options.vertex_order,
    }


@dataclass(frozen=True)
class Output:
    """A kind of file that a command writes.

    Attributes
    ----------
    flags, metavar, help
        Of its argument.
    write
        Writes the file for all results, or for one where `one_each`.
    endings
        File endings that can be written; empty: any.
    one_each
        Whether each of several results gets a file of its own, with the object's name in the file's.
    whole
        Whether the file is about a surface, whatever number of objects are its parts: the name is the first one's.
    """

    flags: tuple[str, ...]
    metavar: str
    help: str
    write: Callable[[Path, Sequence[Made]], None]
    endings: tuple[str, ...] = ()
    one_each: bool = False
    whole: bool = False

    @property
    def name(self) -> str:
        """Where the parsed arguments hold the path."""
        return self.flags[-1].removeprefix("--")

    def add_to(self, parser: argparse.ArgumentParser, **options: Any) -> None:
        """Add the argument; what cannot be written is refused while the arguments are parsed."""
        parser.add_argument(*self.flags, type=self.path, metavar=self.metavar, help=self.help, **options)

    def path(self, text: str) -> Path:
        """Return the path of a file to write; its folder must exist.

        Raises
        ------
        argparse.ArgumentTypeError
            When it is a folder, lies in none or in one that cannot be written, or its name is too long or its ending
            names no kind of file that can be written.
        """
        path = Path(text)
        wrong = _cannot_be(text, path)
        if wrong:
            raise argparse.ArgumentTypeError(wrong)
        if self.endings and path.suffix.lower() not in self.endings:
            one_of = "one of " * (len(self.endings) > 1) + " ".join(self.endings)
            raise argparse.ArgumentTypeError(f"the file's ending must be {one_of}, not '{path.suffix}'")
        if path.suffix.lower() in ONLY_PLAIN and (missing := missing_library(path)):
            raise argparse.ArgumentTypeError(missing.rstrip("."))
        return path


def _cannot_be(text: str, path: Path) -> str:
    """Say why no file can be there, in Blender's notation of paths too; empty where one can."""
    folder = path.absolute().parent
    if len(os.fsencode(path.name)) > LONGEST_NAME:
        return f"the name '{path.name[:20]}...' is too long"
    if text.startswith("//") and os.name == "posix":
        return f"'{text}' begins with //, which means another folder to Blender than to other programs"
    if not folder.is_dir():
        return f"there is no folder '{path.parent}'"
    if path.is_dir():
        return f"'{path}' is a folder"
    if not os.access(path if path.exists() and not path.is_file() else folder, os.W_OK):
        return f"'{path}' cannot be written: its folder is read-only"
    return ""


def same_output(options: argparse.Namespace, outputs: Sequence[Output]) -> str:
    """Say which two outputs are one file; empty where none are."""
    seen: dict[str, str] = {}
    for output in outputs:
        path = getattr(options, output.name, None)
        if path is None or (path.exists() and not path.is_file()):
            continue
        if (other := seen.setdefault(os.path.realpath(path), output.flags[-1])) != output.flags[-1]:
            return f"{other} and {output.flags[-1]} name the same file"
    return ""


def write_json(path: Path, values: Any) -> None:
    """Write plain values; the file appears when it is complete."""
    with atomic_output(path) as draft:
        draft.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def _write_meshes(path: Path, made: Sequence[Made]) -> None:
    """Write the results, or finer ones evaluated from their representations."""
    import bpy

    from ..operators.files.meshes import write_meshes
    from ..operators.representation.resampled import resample_object, resample_parts

    fine = []
    for together in _surfaces(made):
        splits = together[0].resolution
        if splits and together[0].part is not None:
            results, parts = [each.result for each in together], [each.part for each in together]
            fine += resample_parts(bpy.context, results, parts, together[0].representation, splits)
        elif splits:
            fine += [resample_object(bpy.context, each.result, splits) for each in together]
    written = fine or [each.result for each in made]
    # A scene holds both; distances have no source beside them.
    models = [each.source for each in made if each.measured is None and path.suffix != ".blend"]
    source = made[0].input if models and not fine else None
    write_meshes(path, written, made[0].error_colours, models, source)


def _surfaces(made: Sequence[Made]) -> list[list[Made]]:
    """Return the results in order, parts of one surface together."""
    found: dict[int, list[Made]] = {}
    for each in made:
        found.setdefault(id(each if each.part is None else each.representation), []).append(each)
    return list(found.values())


def _write_report(path: Path, made: Sequence[Made]) -> None:
    write_json(path, _figures(made))


def _figures(made: Sequence[Made]) -> dict[str, Any]:
    """Return the report of a result, or those of several by name."""
    return made[0].report if len(made) == 1 else {each.source.name: each.report for each in made if each.report}


def _write_representation(path: Path, made: Sequence[Made]) -> None:
    each = made[0]
    each.representation.save(path, each.quality, keep_vertex_order=each.vertex_order == "keep")


def _write_heat_map(path: Path, made: Sequence[Made]) -> None:
    from ..operators.heat_map.picture import render_heatmap

    with _shown_beside(made[0]) as source:
        shown = made[0].shown or made[0].result
        render_heatmap(shown, path, source=source, up=up_axis(made[0].input), caption=made[0].caption)


@contextlib.contextmanager
def _shown_beside(made: Made) -> Iterator[Any]:
    """Yield the source, or an object that looks like it if it is a point cloud, which no renderer shows."""
    if "points" not in made.report["input"]:
        yield made.source
        return
    import bpy

    from ..operators.data.points import local_points
    from ..operators.heat_map.point_shapes import create_point_shapes

    points = local_points(made.source, bpy.context.evaluated_depsgraph_get())
    shapes = create_point_shapes(made.source.name, points, made.report["input"]["spacing"])
    shapes.matrix_world = made.source.matrix_world
    bpy.context.scene.collection.objects.link(shapes)
    bpy.context.view_layer.update()
    try:
        yield shapes
    finally:
        bpy.data.meshes.remove(shapes.data)


def _write_csv(path: Path, made: Sequence[Made]) -> None:
    from ..operators.measure.showing import write_csv

    write_csv(path, made[0].measured)


def _write_histogram(path: Path, made: Sequence[Made]) -> None:
    from ..operators.measure.histogram import render_histogram

    render_histogram(made[0].measured, made[0].caption, path)


def _write_page(path: Path, made: Sequence[Made]) -> None:
    from ..operators.measure.page import write_page

    each = made[0]
    write_page(path, each.shown, each.source, each.measured, each.caption, up_axis(each.input))


MESH = Output(("-o", "--output"), "OUTPUT", f"mesh file: {' '.join(WRITABLE)}", _write_meshes, WRITABLE)
REPORT = Output(("--report",), "REPORT.json", "file for the figures of the result", _write_report)
HEAT_MAP = Output(("--heatmap",), "PICTURE.png", "picture of the error", _write_heat_map, (".png",), one_each=True)
OUTPUTS = (
    MESH,
    REPORT,
    Output(
        ("--representation",),
        "REP.npz",
        "file for the functions, to evaluate later",
        _write_representation,
        one_each=True,
        whole=True,
    ),
    HEAT_MAP,
)
"""What `approximate` and `reconstruct` write; a row is all that a new kind of file takes."""


DISTANCE_OUTPUTS = (
    MESH,
    REPORT,
    Output(("--csv",), "FILE.csv", "file for the distance at each vertex of A", _write_csv, (".csv",)),
    Output(("--histogram",), "FILE.png", "picture of the histogram", _write_histogram, (".png",)),
    HEAT_MAP,
    Output(("--page",), "FILE.html", "inspection report with pictures, in one file", _write_page, (".html",)),
)
"""What `distance` writes."""


def write_outputs(options: argparse.Namespace, made: Sequence[Made], outputs: Sequence[Output] | None = None) -> None:
    """Write the files that were asked for, each complete or not at all; of `OUTPUTS` where no others are named.

    Figures are printed in the end, where they were asked for: who reads them finds the files there.
    """
    for output in OUTPUTS if outputs is None else outputs:
        path = getattr(options, output.name)
        if path is not None:
            known = made if output is MESH else [each for each in made if each.report]
            wanted = [together[0] for together in _surfaces(known)] if output.whole else known
            if not wanted:
                continue
            if not output.one_each or len(wanted) == 1:
                output.write(path, wanted)
            else:
                for each, own in zip(wanted, _own_paths(path, wanted), strict=True):
                    output.write(own, [each])
    console.figures(_figures(made))


def _own_paths(path: Path, made: Sequence[Made]) -> list[Path]:
    """Return a file for each of several objects: its name ends with the object's, and a number where two are alike."""
    import bpy

    paths: list[Path] = []
    for each in made:
        stem = f"{path.stem}_{bpy.path.clean_name(each.source.name)}"
        names = (path.with_stem(f"{stem}_{number}" if number > 1 else stem) for number in range(1, len(made) + 1))
        paths.append(next(name for name in names if name not in paths))
    return paths

"""The command line: `python -m sparse_surface ...` and `blender --command sparse_surface ...`.

Exit codes: 0 done, 1 refused input (one line on standard error), 2 wrong usage, 130 cancelled.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import importlib.util
import json
import os
import sys
from collections.abc import Callable, Container, Iterator, Sequence
from pathlib import Path
from typing import Any

from ..solver.cloud_settings import CloudSettings
from ..solver.errors import SettingsError, SparseSurfaceError
from ..solver.progress import Progress, run_to_end
from ..solver.settings import PRESETS, Settings
from ..solver.version import VERSION

DONE, REFUSED, WRONG_USAGE, CANCELLED = 0, 1, 2, 130

PROGRAM = "sparse_surface"

MESH_ONLY = (
    "denoise",
    "denoise_strength",
    "mark_creases",
    "noise_level",
    "observations",
    "pin_boundary",
)
"""Settings that only say something about meshes."""

RESAMPLE_HELP = "split every edge of the result into N and evaluate the surface there"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code.

    The scene that Blender has open is replaced: this is for a process of its own.
    """
    parser = build_parser()
    try:
        options = parser.parse_args(arguments)
        work: Callable[[argparse.Namespace], None] = options.work
    except SystemExit as end:  # argparse has said why
        return int(end.code or DONE)
    try:
        work(options)
    except SettingsError as error:
        print(f"{PROGRAM}: {error}", file=sys.stderr)
        return WRONG_USAGE
    except (SparseSurfaceError, OSError, MemoryError) as error:
        print(f"{PROGRAM}: {_one_line(error)}", file=sys.stderr)
        return REFUSED
    except KeyboardInterrupt:
        print(f"{PROGRAM}: cancelled", file=sys.stderr)
        return CANCELLED
    return DONE


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = argparse.ArgumentParser(
        prog=PROGRAM,
        description="Smooth patches that keep the sharp features of a mesh.",
        epilog="Exit codes: 0 done, 1 refused input, 2 wrong usage, 130 cancelled.",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {VERSION}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_approximate(commands)
    _add_reconstruct(commands)
    _add_evaluate(commands)
    _add_inspect(commands)
    _add_compare(commands)
    _add_benchmark(commands)
    return parser


def _add_approximate(commands: Any) -> None:
    parser = commands.add_parser(
        "approximate",
        help="approximate the meshes of a file",
        description="Approximate the meshes of a file that Blender reads; lengths are in the file's unit.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="mesh file: .obj .ply .stl .blend .glb ...")
    add_output_arguments(parser)
    parser.add_argument("--object", metavar="NAME", help="approximate only this object of the file")
    add_setting_arguments(parser)
    parser.set_defaults(work=approximate_file)


def _add_reconstruct(commands: Any) -> None:
    parser = commands.add_parser(
        "reconstruct",
        help="make a surface of the points of a file",
        description="Make a surface of a point cloud; lengths are in the file's unit.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "input", type=Path, metavar="POINTS", help="file with points: .ply .obj .xyz and what Blender reads"
    )
    base = parser.add_mutually_exclusive_group()
    base.add_argument("--base", type=Path, metavar="BASE", help="file with a coarse mesh near the points")
    base.add_argument(
        "--base-vertices",
        type=positive_number,
        metavar="N",
        help="vertices of the base that is made from the points where none is given (default: one for 60 points)",
    )
    add_output_arguments(parser)
    parser.add_argument("--object", metavar="NAME", help="take only this object's points")
    group = parser.add_argument_group("points")
    for item in dataclasses.fields(CloudSettings):
        _add_setting(group, item, "cloud")
    own = {item.name for item in dataclasses.fields(CloudSettings)}
    add_setting_arguments(parser, leave_out=own | set(MESH_ONLY))
    parser.set_defaults(work=reconstruct_file)


def _add_evaluate(commands: Any) -> None:
    parser = commands.add_parser(
        "evaluate",
        help="evaluate a saved representation on a finer mesh",
        description="Evaluate a representation, in its object's own coordinates, on its mesh with split edges.",
    )
    parser.add_argument("representation", type=Path, metavar="REP.npz", help="what --representation wrote")
    parser.add_argument("--resample", type=positive_number, default=1, metavar="N", help=RESAMPLE_HELP)
    parser.add_argument("-o", "--output", type=output_path, required=True, metavar="OUTPUT", help="file for the mesh")
    parser.set_defaults(work=evaluate_file)


def _add_inspect(commands: Any) -> None:
    parser = commands.add_parser(
        "inspect",
        help="look at one patch of a saved representation",
        description="List the functions that a patch uses and how its energy fell; write its domains and functions.",
    )
    parser.add_argument("representation", type=Path, metavar="REP.npz", help="what --representation wrote")
    parser.add_argument("--patch", type=int, metavar="K", help="number of the patch; without it all are listed")
    parser.add_argument("--report", type=output_path, metavar="REPORT.json", help="file for what is listed")
    parser.add_argument(
        "-o",
        "--output",
        type=output_path,
        metavar="OUTPUT",
        help="file for the patch, its initial and its optimised domain laid flat, and its functions over the domain",
    )
    parser.set_defaults(work=inspect_file)


def _add_compare(commands: Any) -> None:
    parser = commands.add_parser(
        "compare",
        help="approximate a mesh by two presets on one colour scale",
        description="Approximate a mesh twice; the results stand side by side, their errors on one colour scale.",
    )
    parser.add_argument("input", type=Path, metavar="INPUT", help="mesh file: .obj .ply .stl .blend .glb ...")
    names = sorted(PRESETS)
    parser.add_argument("--first", choices=names, default="default", help="preset of the first result")
    parser.add_argument("--second", choices=names, default="paper", help="preset of the second result")
    parser.add_argument("--object", metavar="NAME", help="this object of the file")
    parser.add_argument("-o", "--output", type=output_path, metavar="OUTPUT", help="file for both results")
    parser.add_argument("--report", type=output_path, metavar="REPORT.json", help="file for both reports")
    add_setting_arguments(parser, presets=False)
    parser.set_defaults(work=compare_file)


def _add_benchmark(commands: Any) -> None:
    parser = commands.add_parser(
        "benchmark",
        help="measure speed and accuracy",
        description="Measure speed, in units of a matrix product, and accuracy; prints tables.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument(
        "--models", nargs="+", metavar="MODEL", help="generated, downloaded, or mesh files; default: all"
    )
    parser.add_argument("--json", type=output_path, metavar="FILE", help="file for all figures")
    parser.add_argument("--docs", type=Path, metavar="FOLDER", help="folder for performance.md and accuracy.md")
    parser.add_argument("--only", choices=["performance", "accuracy"], help="measure only this")
    parser.add_argument("--largest", type=int, default=1_000_000, metavar="N", help="vertices of the largest terrain")
    folder = Path(__file__).resolve().parent.parent / "shared" / "models"
    parser.add_argument("--folder", type=Path, default=folder, metavar="FOLDER", help="where downloaded models are")
    parser.set_defaults(work=run_benchmark)


def run_benchmark(options: argparse.Namespace) -> None:
    """Do the command `benchmark`."""
    from ..solver.errors import InputError

    try:
        from ..benchmarks.command import benchmark
    except ImportError as error:
        raise InputError(f"The benchmark comes with the Python package, not with the extension ({error}).") from error
    if options.docs is not None and not options.docs.is_dir():
        raise SettingsError(f"There is no folder '{options.docs}'.")
    parts = [options.only] if options.only else ["performance", "accuracy"]
    benchmark(options.models, options.json, options.docs, options.largest, options.folder, parts)


def add_output_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name what is written."""
    parser.add_argument(
        "-o", "--output", type=output_path, metavar="OUTPUT", help="file for the result; without it no mesh is written"
    )
    parser.add_argument("--report", type=output_path, metavar="REPORT.json", help="file for the report")
    parser.add_argument(
        "--representation", type=output_path, metavar="REP.npz", help="file for the functions, to evaluate later"
    )
    parser.add_argument("--resample", type=positive_number, metavar="N", help=RESAMPLE_HELP)
    parser.add_argument("--domain-maps", action="store_true", help="write the patches' domains as UV maps")
    parser.add_argument("--heatmap", type=output_path, metavar="PICTURE.png", help="picture of the error")


def add_setting_arguments(
    parser: argparse.ArgumentParser, leave_out: Container[str] = (), *, presets: bool = True
) -> None:
    """Add an argument for each setting, made from the solver's own list, and the presets."""
    group = parser.add_argument_group("settings")
    if presets:
        group.add_argument("--preset", choices=sorted(PRESETS), help="settings to start from; others change them")
    for item in dataclasses.fields(Settings):
        if item.name not in leave_out:
            _add_setting(group, item, "setting")


def _add_setting(group: Any, item: dataclasses.Field[Any], kind: str) -> None:
    """Add the argument of one setting; its value is found under `<kind>_<name>`."""
    flag = "--" + item.name.replace("_", "-")
    text = item.metadata["text"].replace("%", "%%")
    # No default of its own: only what is given changes the preset.
    common: dict[str, Any] = {"default": argparse.SUPPRESS, "dest": f"{kind}_{item.name}"}
    if "choices" in item.metadata:
        choices = item.metadata["choices"]
        group.add_argument(flag, choices=list(choices), help=f"{text} (default: {item.default})", **common)
    elif isinstance(item.default, bool):
        state = "on" if item.default else "off"
        group.add_argument(flag, action=argparse.BooleanOptionalAction, help=f"{text} (default: {state})", **common)
    else:
        low, high = item.metadata["low"], item.metadata["high"]
        help_text = f"{text} ({low:g} to {high:g}, default: {item.default:g})"
        group.add_argument(flag, type=type(item.default), metavar="N", help=help_text, **common)


def settings_of(options: argparse.Namespace, preset: str | None = None) -> Settings:
    """Return the settings: those of the preset, changed by what was given."""
    return Settings(**{**PRESETS[preset or options.preset or "default"], **_given(options, "setting_")})


def _given(options: argparse.Namespace, beginning: str) -> dict[str, Any]:
    return {name.removeprefix(beginning): value for name, value in vars(options).items() if name.startswith(beginning)}


def output_path(text: str) -> Path:
    """Return the path of a file to write; its folder must be there.

    Raises
    ------
    argparse.ArgumentTypeError
        When there is no such folder.
    """
    path = Path(text)
    if not path.absolute().parent.is_dir():
        raise argparse.ArgumentTypeError(f"there is no folder '{path.parent}'")
    if path.is_dir():
        raise argparse.ArgumentTypeError(f"'{path}' is a folder")
    return path


@dataclasses.dataclass(frozen=True)
class Made:
    """A result with what it was made from: objects in Blender, and the report."""

    source: Any
    result: Any
    report: dict[str, Any]
    representation: Any


def positive_number(text: str) -> int:
    """Return a whole number from 1 up.

    Raises
    ------
    argparse.ArgumentTypeError
        When it is none.
    """
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is no whole number from 1 up")
    return int(text)


def evaluate_file(options: argparse.Namespace) -> None:
    """Do the command `evaluate`."""
    from ..solver.surface.representation import Representation
    from ..solver.surface.resampling import resample_steps

    check_writable_kinds(options)
    representation = Representation.load(options.representation)
    import bpy

    from ..operators.data import meshes as mesh_data
    from ..operators.files import formats as files

    name = options.representation.stem
    with progress_display(name) as show:
        resampled = run_to_end(resample_steps(representation, options.resample), show)
    bpy.ops.wm.read_homefile(use_empty=True)
    mesh = mesh_data.create_mesh(name, resampled.vertices, resampled.corners, resampled.sizes)
    made = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(made)
    files.write_meshes(options.output, [made])
    print(f"{name}: {len(mesh.vertices)} vertices, {len(mesh.polygons)} faces", flush=True)


def inspect_file(options: argparse.Namespace) -> None:
    """Do the command `inspect`."""
    from ..solver.surface.representation import Representation

    check_writable_kinds(options)
    if options.output is not None and options.patch is None:
        raise SettingsError("Name a patch with --patch to write it.")
    surface = Representation.load(options.representation)
    listed = [
        _describe_patch(surface, patch)
        for patch in (range(surface.patches) if options.patch is None else [options.patch])
    ]
    for patch in listed:
        energy = patch["energy"]
        fell = f", energy {energy[-1]:.3g} of the first iteration's" if energy else ""
        print(f"patch {patch['patch']}: {patch['vertices']} vertices, {len(patch['functions'])} functions{fell}")
        for function in patch["functions"] if options.patch is not None else ():
            amounts = " ".join(f"{amount:12.4e}" for amount in function["amounts"])
            print(f"  {function['name']:<16} {amounts}")
    if options.report is not None:
        _write_json(options.report, listed if options.patch is None else listed[0])
    if options.output is not None:
        _write_patch(options, surface)


def _describe_patch(surface: Any, patch: int) -> dict[str, Any]:
    """Return number, vertices, functions with their amounts in x, y and z, and energies of a patch."""
    from ..solver.surface.inspection import patch_energy, patch_terms

    functions = [{"name": term.name, "amounts": list(term.amounts)} for term in patch_terms(surface, patch)]
    size = int(surface.vertex_offsets[patch + 1] - surface.vertex_offsets[patch])
    return {"patch": patch, "vertices": size, "functions": functions, "energy": patch_energy(surface, patch)}


def _write_patch(options: argparse.Namespace, surface: Any) -> None:
    import bpy
    import numpy as np

    from ..operators.data import meshes as mesh_data
    from ..operators.files import formats as files
    from ..operators.representation.patch_sheets import lay_out_patch

    bpy.ops.wm.read_homefile(use_empty=True)
    name = options.representation.stem
    points = np.ascontiguousarray(surface.at_vertices(), dtype=np.float32)
    mesh = mesh_data.create_mesh(name, points, surface.face_corners, np.diff(surface.face_offsets))
    holder = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(holder)
    shown = lay_out_patch(bpy.context, holder, surface, options.patch)
    files.write_meshes(options.output, shown)


def compare_file(options: argparse.Namespace) -> None:
    """Do the command `compare`."""
    if options.first == options.second:
        raise SettingsError("Choose two presets that differ.")
    settings = [settings_of(options, preset) for preset in (options.first, options.second)]
    check_writable_kinds(options)
    import bpy

    from ..operators.data import meshes as mesh_data
    from ..operators.data.colours import ColourScale
    from ..operators.files import formats as files
    from ..operators.heat_map.pairs import make_pair
    from ..solver.errors import InputError
    from ..solver.job import approximate_arrays

    found = _chosen(files.read_meshes(options.input), options.object)
    if len(found) > 1:
        raise InputError(f"The file has {len(found)} meshes; name one of them with --object.")
    read = mesh_data.read_object(found[0], bpy.context.evaluated_depsgraph_get())
    titles = [options.first, options.second]
    done = []
    for title, chosen in zip(titles, settings, strict=True):
        with progress_display(title) as show:
            done.append((read, run_to_end(approximate_arrays(read.arrays, chosen), show)))
        print(summary(title, done[-1][1].report), flush=True)
    largest = max(float(result.error.max(initial=0.0)) for _, result in done)
    made = make_pair(bpy.context, done, [title.title() for title in titles], ColourScale(0.0, largest), beside=True)
    if options.report is not None:
        _write_json(options.report, {title: result.report for title, (_, result) in zip(titles, done, strict=True)})
    if options.output is not None:
        files.write_meshes(options.output, made)


def approximate_file(options: argparse.Namespace) -> None:
    """Do the command `approximate`."""
    settings = settings_of(options)
    import bpy

    from ..operators.data import meshes as mesh_data
    from ..operators.data.colours import ColourScale
    from ..operators.data.results import create_result
    from ..operators.files import formats as files
    from ..solver.job import approximate_arrays

    check_writable_kinds(options)
    made = []
    for source in _chosen(files.read_meshes(options.input), options.object):
        read = mesh_data.read_object(source, bpy.context.evaluated_depsgraph_get())
        with progress_display(source.name) as show:
            result = run_to_end(approximate_arrays(read.arrays, settings), show)
        scale = ColourScale(0.0, float(result.error.max(initial=0.0)))
        made_object = create_result(bpy.context, read, result, scale)
        made.append(Made(source, made_object, result.report, result.representation))
        print(summary(source.name, result.report), flush=True)
    write_outputs(options, made)


def reconstruct_file(options: argparse.Namespace) -> None:
    """Do the command `reconstruct`."""
    settings, cloud = settings_of(options), CloudSettings(**_given(options, "cloud_"))
    _require_blender()
    import bpy

    from ..operators.data.colours import ColourScale
    from ..operators.data.points import read_cloud
    from ..operators.data.results import create_surface
    from ..operators.files import points as point_files
    from ..solver.reconstruction.evaluated import reconstruct_arrays

    check_writable_kinds(options)
    arrays = point_files.read_base(options.base) if options.base else None
    points = point_files.read_points(options.input, options.object)
    base = point_files.create_base(*arrays, options.base.stem) if arrays else None
    source = read_cloud(bpy.context, points, base, options.base_vertices or 0, cloud, options.resample or 0)
    with progress_display(points.name) as show:
        result = run_to_end(reconstruct_arrays(source.arrays, settings), show)
    scale = ColourScale(0.0, float(result.point_error.max(initial=0.0)))
    surface = create_surface(bpy.context, source, result, scale)
    print(cloud_summary(points.name, result.report), flush=True)
    options.resample = None  # the surface has that resolution already
    write_outputs(options, [Made(points, surface, result.report, result.representation)])


def _require_blender() -> None:
    """Say in a sentence that there is no bpy, where there is none."""
    from ..solver.errors import InputError

    if importlib.util.find_spec("bpy") is None:
        raise InputError("Files are read with Blender: install its Python module (pip install bpy) or run in Blender.")


def check_writable_kinds(options: argparse.Namespace) -> None:
    """Refuse an output that could not be written before hours of work are put into it.

    Raises
    ------
    SettingsError
        When the ending names no kind of file that can be written.
    """
    from ..operators.files.formats import WRITABLE

    if options.output is not None and options.output.suffix.lower() not in WRITABLE:
        raise SettingsError(f"The output's ending must be one of {' '.join(WRITABLE)}, not '{options.output.suffix}'.")
    heat_map = getattr(options, "heatmap", None)
    if heat_map is not None and heat_map.suffix.lower() != ".png":
        raise SettingsError(f"The heat map's ending must be .png, not '{heat_map.suffix}'.")


def write_outputs(options: argparse.Namespace, made: list[Made]) -> None:
    """Write the files that were asked for, each complete or not at all."""
    from ..operators.files import formats as files
    from ..operators.representation.domain_maps import write_domain_maps

    for each in made if options.domain_maps else ():
        write_domain_maps(each.result)
    if options.output is not None:
        files.write_meshes(options.output, [_resampled(each.result, options.resample) for each in made])
    if options.report is not None:
        report = made[0].report if len(made) == 1 else {each.source.name: each.report for each in made}
        _write_json(options.report, report)
    for each in made:
        if options.representation is not None:
            each.representation.save(_of_object(options.representation, each, made))
    if options.heatmap is not None:
        _render_heat_maps(options, made)


def _write_json(path: Path, values: Any) -> None:
    from ..operators.files.atomic import beside

    with beside(path) as draft:
        draft.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def _resampled(result: Any, splits: int | None) -> Any:
    """Return the object to write: the result, or a finer one evaluated from its representation."""
    if splits is None:
        return result
    import bpy

    from ..operators.representation.resampled import resample_object

    return resample_object(bpy.context, result, splits)


def _of_object(path: Path, each: Made, made: list[Made]) -> Path:
    """Return the file for one of several objects: the name that was given, with the object's own in it."""
    if len(made) == 1:
        return path
    import bpy

    return path.with_stem(f"{path.stem}_{bpy.path.clean_name(each.source.name)}")


def _render_heat_maps(options: argparse.Namespace, made: list[Made]) -> None:
    from ..operators.heat_map.picture import render_heatmap

    up = "Y" if options.input.suffix.lower() == ".obj" else "Z"  # what the format's writers agree on
    for each in made:
        with _shown_beside(each) as source:
            render_heatmap(each.result, _of_object(options.heatmap, each, made), source=source, up=up)


@contextlib.contextmanager
def _shown_beside(made: Made) -> Iterator[Any]:
    """The source; where it is a point cloud, which no renderer shows, an object that looks like it."""
    if "points" not in made.report["input"]:
        yield made.source
        return
    import bpy

    from ..operators.data import points as cloud_data
    from ..operators.heat_map.point_shapes import create_point_shapes

    points, lengths = cloud_data.read_points(made.source, bpy.context.evaluated_depsgraph_get())
    spacing = made.report["input"]["spacing"]
    shapes = create_point_shapes(made.source.name, lengths.to_local(points), spacing)
    shapes.matrix_world = made.source.matrix_world
    bpy.context.scene.collection.objects.link(shapes)
    bpy.context.view_layer.update()
    try:
        yield shapes
    finally:
        bpy.data.meshes.remove(shapes.data)


def _chosen(objects: list[Any], name: str | None) -> list[Any]:
    from ..operators.files.formats import named

    return objects if name is None else named(objects, name)


def summary(name: str, report: dict[str, Any]) -> str:
    """Return one line about a result."""
    surface, relative = report["surface_error"], report["relative"]
    begins = f"{name}: {report['input']['vertices']} vertices, "
    ends = f", {report['seconds']['total']:.1f} s"
    if "denoise" in report:
        begins += noise_taken_off(report["denoise"])
        if not report["patches"]:
            return begins + ends
        # what the functions do to the denoised mesh
        fit, size = report["denoise"]["fit"], report["input"]["bounding_box_longest_side"]
        surface = fit["surface_error"]
        relative = {"surface_rms": surface["rms"] / size, "surface_max": surface["max"] / size}
        begins += "; fitted with "
    return (
        f"{begins}{report['patches']} patches, surface error "
        f"rms {surface['rms']:.3g} ({relative['surface_rms']:.2e} of the size), max {surface['max']:.3g} "
        f"({relative['surface_max']:.2e}){ends}"
    )


def noise_taken_off(noise: dict[str, Any]) -> str:
    """Say how much noise was taken off, from that part of a report."""
    if not noise["noise_level"]:
        return "no noise taken off"
    moved = noise["displacement"]
    return (
        f"noise of {noise['noise_level']:.3g} ({noise['relative_noise']:.0%} of the mean edge) taken off, "
        f"vertices moved by rms {moved['rms']:.3g}, max {moved['max']:.3g}"
    )


def cloud_summary(name: str, report: dict[str, Any]) -> str:
    """Return one line about a reconstruction."""
    surface, relative, size = report["surface_error"], report["relative"], report["input"]
    return (
        f"{name}: {size['points']} points over {size['vertices']} vertices, {report['patches']} patches, error "
        f"rms {surface['rms']:.3g} ({relative['surface_rms']:.2e} of the size), max {surface['max']:.3g} "
        f"({relative['surface_max']:.2e}), {report['seconds']['total']:.1f} s"
    )


@contextlib.contextmanager
def progress_display(name: str) -> Iterator[Callable[[Progress], None]]:
    """Show progress: a bar on a terminal where tqdm is there to draw it, plain lines otherwise."""
    bar_class = _bar_class() if sys.stderr.isatty() else None
    if bar_class is None:
        yield _PlainLines(name)
        return
    with bar_class(total=100.0, desc=name, bar_format="{desc}: {percentage:3.0f}%|{bar}| {postfix} {remaining}") as bar:

        def show(step: Progress) -> None:
            bar.set_postfix_str(" ".join(part for part in (step.stage, step.detail) if part), refresh=False)
            bar.update(100.0 * step.fraction - bar.n)

        yield show


def _bar_class() -> Any | None:
    try:
        from tqdm import tqdm
    except ImportError:  # Blender does not bring it
        return None
    return tqdm


@dataclasses.dataclass
class _PlainLines:
    """Prints a line for each stage and each tenth of the work."""

    name: str
    _said: tuple[str, int] = ("", -1)

    def __call__(self, step: Progress) -> None:
        now = (step.stage, int(10.0 * step.fraction))
        if now != self._said:
            self._said = now
            detail = f" ({step.detail})" if step.detail else ""
            print(f"{self.name}: {step.fraction:4.0%} {step.stage}{detail}", flush=True)


def _one_line(error: BaseException) -> str:
    if isinstance(error, OSError) and error.strerror:
        where = f" '{os.fspath(error.filename)}'" if error.filename else ""
        return f"{error.strerror}{where}."
    return " ".join(str(error).split()) or "There is not enough memory for this mesh."

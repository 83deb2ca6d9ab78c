"""What can be asked of the command line.  Needs no Blender: the module of a command is imported when it runs."""

from __future__ import annotations

import argparse
import dataclasses
import functools
from collections.abc import Callable, Container, Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from ..operators.files.formats import ERROR_COLOURS, ORDERS, POINTS, QUALITIES, READABLE
from ..solver.distance.settings import ALIGNMENTS, DistanceSettings
from ..solver.settings import MOST_POINTS, PRESETS, CloudSettings, Settings
from ..solver.version import VERSION
from .completion import SHELLS, PrintCompletion
from .outputs import DISTANCE_OUTPUTS, MESH, OUTPUTS, REPORT, same_output

PROGRAM = "sparse_surface"

MESH_ONLY = {
    *("denoise", "denoise_strength", "mark_creases", "merge_distance", "merge_vertices", "noise_level"),
    *("observations", "pin_boundary"),
}
"""Settings that concern meshes only."""

EXIT_CODES = (
    "Exit codes: 0 done, 1 input refused or work failed, 2 wrong usage; "
    "cancelled: 129 by SIGHUP, 130 by SIGINT (Ctrl C), 143 by SIGTERM."
)
"""What the help of every command ends with."""


def parse(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what the words ask for: `command`, its arguments, and where it takes them `settings` and `cloud`.

    Raises
    ------
    SystemExit
        On wrong usage, which argparse explains, and after the help.
    SettingsError
        When a setting is out of range.
    """
    parser = _parser()
    options = parser.parse_args(words)
    twice = same_output(options, [*OUTPUTS, *DISTANCE_OUTPUTS])
    if twice:
        parser.error(twice)
    for settle in options.settle:
        settle(options)
    return options


class _Parser(argparse.ArgumentParser):
    """Says what is wrong in one line: the usage of a command with all its settings is thirty."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message} (--help lists what there is)\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog=PROGRAM,
        description="Smooth patches that keep the sharp features of a mesh.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {VERSION}")
    text = f"print a script that completes words in {', '.join(SHELLS)}"
    parser.add_argument("--print-completion", action=PrintCompletion, choices=SHELLS, metavar="SHELL", help=text)
    commands = parser.add_subparsers(required=True, metavar="COMMAND", dest="command")
    for add, name, summary in COMMANDS:
        form = argparse.ArgumentDefaultsHelpFormatter
        command = commands.add_parser(name, help=summary, description=summary, epilog=EXIT_CODES, formatter_class=form)
        command.set_defaults(settle=add(command) or ())
        _add_manners(command)
    return parser


Settle = Callable[[argparse.Namespace], None]


def _add_manners(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print the figures as JSON, all else on standard error")
    loud = parser.add_mutually_exclusive_group()
    loud.add_argument("-v", "--verbose", action="store_true", help="say where time and memory went, too")
    loud.add_argument("-q", "--quiet", action="store_true", help="print errors only, and what --json asks for")


def _add_approximate(parser: argparse.ArgumentParser) -> Sequence[Settle]:
    _add_input(parser, "INPUT", "mesh file", READABLE)
    parser.add_argument("--object", metavar="NAME", help="approximate only this object of the file")
    parser.add_argument("--strict", action="store_true", help="exit with 1 where one of several meshes was refused")
    _add_outputs(parser)
    _add_blocks(parser)
    return [_add_settings(parser, Settings, presets=True)]


def _add_blocks(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("large meshes", "With one of these, the mesh is approximated in blocks.")
    group.add_argument(
        "--block-size", type=positive_number, metavar="N", help="vertices in a block, at most; 250000 where not given"
    )
    group.add_argument("--cluster", metavar="ADDRESS", help="solve the blocks on a Dask cluster, as tcp://host:8786")
    group.add_argument(
        "--resume", type=Path, metavar="FOLDER", help="keep finished blocks here, and go on with those that are there"
    )


def _add_reconstruct(parser: argparse.ArgumentParser) -> Sequence[Settle]:
    _add_input(parser, "POINTS", "file with points", POINTS)
    base = parser.add_mutually_exclusive_group()
    base.add_argument("--base", type=Path, metavar="BASE", help="file with a coarse mesh near the points")
    base.add_argument(
        "--base-vertices",
        type=positive_number,
        metavar="N",
        help="vertices of the base that is made from the points if none is given (default: one for 24 to 60 points)",
    )
    parser.add_argument("--object", metavar="NAME", help="take only this object's points")
    text = (
        f"merge them in the cells of a grid until N are left at most; clouds of more than {MOST_POINTS} are in any case"
    )
    large = parser.add_argument_group(
        "large clouds", "Points are read in parts, fitted where they are merged, all measured."
    )
    large.add_argument("--most-points", type=positive_number, metavar="N", help=text)
    _add_outputs(parser)
    own = {item.name for item in dataclasses.fields(CloudSettings)}
    return [
        _add_settings(parser, CloudSettings, title="points", into="cloud"),
        _add_settings(parser, Settings, presets=True, leave_out=own | MESH_ONLY),
    ]


def _add_evaluate(parser: argparse.ArgumentParser) -> None:
    text = "what --representation wrote: a file, or the folder of a mesh in blocks"
    parser.add_argument("representation", type=Path, metavar="REP.npz", help=text)
    _add_resample(parser, default=1)
    MESH.add_to(parser, required=True)


def _add_inspect(parser: argparse.ArgumentParser) -> Sequence[Settle]:
    def settle(options: argparse.Namespace) -> None:
        if options.output is not None and options.patch is None:
            parser.error("name a patch with --patch to write it")

    parser.add_argument("representation", type=Path, metavar="REP.npz", help="what --representation wrote")
    parser.add_argument("--patch", type=int, metavar="K", help="number of the patch; without it all are listed")
    REPORT.add_to(parser)
    MESH.add_to(parser)
    return [settle]


def _add_compare(parser: argparse.ArgumentParser) -> Sequence[Settle]:
    def settle(options: argparse.Namespace) -> None:
        if options.first == options.second:
            parser.error("choose two presets that differ")
        given = _given(options, "settings")
        options.settings = {name: Settings(**{**PRESETS[name], **given}) for name in (options.first, options.second)}

    _add_input(parser, "INPUT", "mesh file", READABLE)
    names = sorted(PRESETS)
    parser.add_argument("--first", choices=names, default="default", help="preset of the first result")
    parser.add_argument("--second", choices=names, default="paper", help="preset of the second result")
    parser.add_argument("--object", metavar="NAME", help="this object of the file")
    MESH.add_to(parser)
    REPORT.add_to(parser)
    _add_settings(parser, Settings)
    return [settle]


def _add_distance(parser: argparse.ArgumentParser) -> Sequence[Settle]:
    def settle(options: argparse.Namespace) -> None:
        names = [item.name for item in dataclasses.fields(DistanceSettings)]
        options.settings = DistanceSettings(**{n: getattr(options, n) for n in names if hasattr(options, n)})

    for name, metavar in (("first", "A"), ("second", "B")):
        text = f"file with a mesh or points, or a representation (.npz): {' '.join(POINTS)}"
        parser.add_argument(name, type=Path, metavar=metavar, help=text)
    parser.add_argument("--signed", action="store_true", help="distances inside B are negative")
    parser.add_argument("--align", choices=ALIGNMENTS, default="none", help="move A onto B first, or scale it too")
    parser.add_argument("--tolerance", type=float, default=0.0, metavar="T", help="say which share is within T")
    parser.add_argument("--samples", type=positive_number, default=200_000, metavar="N", help="places on each mesh")
    for output in DISTANCE_OUTPUTS:
        output.add_to(parser)
    return [settle]


COMMANDS = (
    (_add_approximate, "approximate", "approximate the meshes of a file; lengths are in its unit"),
    (_add_reconstruct, "reconstruct", "make a surface from the points of a file; lengths are in its unit"),
    (_add_evaluate, "evaluate", "evaluate a saved representation, in its object's coordinates, with split edges"),
    (_add_inspect, "inspect", "list a patch's functions and energies; write its domains and functions laid flat"),
    (_add_compare, "compare", "approximate a mesh with two presets; their errors share one colour scale"),
    (_add_distance, "distance", "measure the distances between any two meshes or point clouds, both ways"),
)
"""What adds the arguments of a command and returns what completes them; its name and summary.

A command is a row here and a module of its name, whose `run` gets the arguments.
"""


def _add_input(parser: argparse.ArgumentParser, metavar: str, what: str, endings: Sequence[str]) -> None:
    parser.add_argument("input", type=Path, metavar=metavar, help=f"{what}: {' '.join(endings)}")


def _add_outputs(parser: argparse.ArgumentParser) -> None:
    for output in OUTPUTS:
        output.add_to(parser)
    _add_resample(parser)
    _add_choice(parser, "--error-colors", ERROR_COLOURS, "colours of the written mesh")
    _add_choice(parser, "--quality", QUALITIES, "what --representation keeps")
    _add_choice(parser, "--vertex-order", ORDERS, "what --representation does with it")
    parser.add_argument("--domain-maps", action="store_true", help="write the patches' domains as UV maps")


def _add_choice(parser: argparse.ArgumentParser, flag: str, choices: Mapping[str, str], what: str) -> None:
    """Add an argument that takes one of some names, the first of which is the default, and explain each."""
    texts = "; ".join(f"{name}: {text}" for name, text in choices.items())
    parser.add_argument(flag, choices=list(choices), default=next(iter(choices)), help=f"{what}. {texts}")


def _add_resample(parser: argparse.ArgumentParser, **options: Any) -> None:
    text = "split every edge of the result into N and evaluate the surface there"
    parser.add_argument("--resample", type=positive_number, metavar="N", help=text, **options)


def positive_number(text: str) -> int:
    """Return a whole number of at least 1; ArgumentTypeError where the text is something else."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least 1")
    return int(text)


def merge_distance(text: str) -> float | None:
    """Return a distance, 0 for `auto` and None for `off`; ArgumentTypeError where the text is something else."""
    if text in ("auto", "off"):
        return 0.0 if text == "auto" else None
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is neither a number nor auto nor off") from None


# ------------------------------------------------------------------------------------------------------------ settings


def _add_settings(
    parser: argparse.ArgumentParser,
    kind: type[Settings] | type[CloudSettings],
    *,
    title: str = "settings",
    into: str = "settings",
    presets: bool = False,
    leave_out: Container[str] = (),
) -> Settle:
    """Add an argument for each field of the settings; returns what makes the settings of the parsed arguments."""
    group = parser.add_argument_group(title)
    if presets:
        group.add_argument("--preset", choices=sorted(PRESETS), help="settings to start from; others change them")
    for item in dataclasses.fields(kind):
        if item.name not in leave_out:
            _add_setting(group, item, f"{into} {item.name}")

    def settle(options: argparse.Namespace) -> None:
        preset = PRESETS[options.preset or "default"] if presets else {}
        setattr(options, into, kind(**{**preset, **_given(options, into)}))

    return settle


def _add_setting(group: Any, item: dataclasses.Field[Any], place: str) -> None:
    """Add the argument of one setting; it has no default, since only what is given changes a preset."""
    text = item.metadata["text"].replace("%", "%%")
    add = functools.partial(
        group.add_argument, "--" + item.name.replace("_", "-"), dest=place, default=argparse.SUPPRESS
    )
    if item.name == "merge_distance":
        add(type=merge_distance, metavar="D|auto|off", help=f"{text.partition(' 0:')[0]} (default: auto)")
    elif "choices" in item.metadata:
        add(choices=list(item.metadata["choices"]), help=f"{text} (default: {item.default})")
    elif isinstance(item.default, bool):
        add(action=argparse.BooleanOptionalAction, help=f"{text} (default: {'on' if item.default else 'off'})")
    else:
        low, high = item.metadata["low"], item.metadata["high"]
        help_text = f"{text} ({low:g} to {high:g}, default: {item.default:g})"
        add(type=type(item.default), metavar="N", help=help_text)


def _given(options: argparse.Namespace, into: str) -> dict[str, Any]:
    """Return the settings that were given, by name."""
    given = {name.partition(" ")[2]: value for name, value in vars(options).items() if name.startswith(f"{into} ")}
    if "merge_distance" in given and given["merge_distance"] is None:
        return {**given, "merge_vertices": False, "merge_distance": 0.0}
    return given

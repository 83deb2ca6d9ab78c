"""The command `benchmark`: chooses models, measures, writes tables and figures."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..solver.errors import InputError
from . import accuracy, denoising, evaluation, performance
from . import generated_models as models
from .cases import Case

PAPERS = ("cube", "cubetorus", "cylinder", "flower")
DOWNLOADED = {"fandisk": "fandisk.obj", "bunny": "stanford-bunny.ply", "rocker-arm": "rocker-arm.obj"}
ALL = (*PAPERS, *DOWNLOADED)
TIMED = ("cube", "fandisk", "bunny")
ABLATED = ("cube", "fandisk")
PARTS = ("performance", "accuracy")


def benchmark(
    names: Sequence[str] | None,
    json_path: Path | None,
    docs: Path | None,
    largest: int,
    folder: Path,
    parts: Sequence[str],
) -> None:
    """Measure and print the tables.

    Parameters
    ----------
    names
        Models: names of generated ones, `fandisk`, `bunny`, `rocker-arm`, or files that Blender reads; all where None.
    json_path
        Where to write all figures as JSON.
    docs
        Folder in which `performance.md` and `accuracy.md` are written.
    largest
        Vertices of the largest terrain.
    folder
        Where the downloaded models are; those that are not there are left out.
    parts
        "performance", "accuracy" or both.

    Raises
    ------
    InputError
        When a model that is asked for is not there.
    """
    cases = _cases(names, folder)
    figures: dict[str, Any] = {}
    chosen = set(names or ())
    for part in parts:
        if part == "performance":
            sizes = [size for size in performance.SIZES if size <= largest] if names is None else []
            timed = [case for case in cases if names is not None or case.model in TIMED]
            text, figures[part] = performance.run(timed, sizes, _say, _write_back())
        else:
            ablated = [case for case in cases if case.model in ABLATED and (names is None or case.model in chosen)]
            text, figures[part] = accuracy.run(cases, ablated, _say)
            for section in (evaluation, denoising):
                more, figures[section.__name__.rpartition(".")[2]] = section.run(cases, _say)
                text += more
        print(text)
        if docs is not None:
            _write(docs / f"{part}.md", text.rstrip() + "\n")
        if json_path is not None:
            _write(json_path, json.dumps(figures, indent=2) + "\n")


def _say(text: str) -> None:
    print(f"benchmark: {text} ...", file=sys.stderr, flush=True)


def _write(path: Path, text: str) -> None:
    """Write beside and rename into place."""
    draft = path.with_name(path.name + ".part")
    draft.write_text(text, encoding="utf-8")
    draft.replace(path)


def _cases(names: Sequence[str] | None, folder: Path) -> list[Case]:
    cases = []
    for name in names or ALL:
        path = folder / DOWNLOADED[name] if name in DOWNLOADED else Path(name)
        if path.is_file():
            cases.append(Case(name if name in DOWNLOADED else path.stem, arrays=_read(path)))
        elif name in DOWNLOADED or not callable(getattr(models, name, None)) or name.startswith("_"):
            if names is not None:
                raise InputError(f"There is no model {name!r}.")
            _say(f"{path} is not there, {name} is left out")
        else:
            cases.append(Case(name))
    return cases


def _read(path: Path) -> tuple[np.ndarray[Any, Any], np.ndarray[Any, Any]]:
    """Read a triangle mesh through Blender, in the file's own axes."""
    try:
        import bpy  # noqa: F401 - before whatever comes with it
    except ImportError as error:
        raise InputError(f"Reading '{path}' takes Blender's Python module, bpy.") from error
    from ..operators.data import meshes as mesh_data
    from ..operators.files.meshes import read_meshes

    mesh = read_meshes(path)[0].data
    corners, sizes = mesh_data.read_polygons(mesh)
    if not (sizes == 3).all():
        raise InputError(f"'{path}' is no triangle mesh.")
    return mesh_data.read_positions(mesh), corners.reshape(-1, 3)


def _write_back() -> Any:
    """What measures the making of a Blender mesh; None where there is no Blender."""
    try:
        import bpy  # noqa: F401
    except ImportError:
        return None
    from .write_back import seconds

    return seconds

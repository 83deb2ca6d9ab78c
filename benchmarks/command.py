"""The command `benchmark`: chooses models, measures, and writes down what was measured."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..solver.errors import InputError
from . import accuracy, alignment, denoising, distances, evaluation, file_sizes, measured, performance, published_noise
from . import generated_models as models
from .cases import Case
from .tables import Table

PAPERS = ("cube", "cubetorus", "cylinder", "flower")
DOWNLOADED = {"fandisk": "fandisk.obj", "bunny": "stanford-bunny.ply", "rocker-arm": "rocker-arm.obj"}
ALL = (*PAPERS, *DOWNLOADED)
TIMED = ("cube", "fandisk", "bunny")
ABLATED = ("cube", "fandisk")
ALIGNED = ("cubetorus", "fandisk", "bunny")

Say = Callable[[str], None]
Result = tuple[dict[str, Table], Any]


def _write_back(cases: Sequence[Case], say: Say) -> Result:
    try:
        from . import write_back
    except ImportError:
        say("without bpy nothing is written back")
        return {}, None
    return write_back.run(cases, say)


PARTS: dict[str, tuple[Sequence[str], Callable[[Sequence[Case], Say], Result]]] = {
    "stages": (TIMED, performance.stages),
    "libraries": (TIMED, performance.libraries),
    "write-back": (TIMED, _write_back),
    "presets": (ALL, accuracy.presets),
    "ablation": (ABLATED, accuracy.ablation),
    "representation": (evaluation.MODELS, evaluation.run),
    "files": (file_sizes.MODELS, file_sizes.run),
    "denoising": (ALL, denoising.run),
    "distances": (ALL, distances.run),
    "alignment": (ALIGNED, alignment.run),
}
"""Parts of the benchmark: models that each takes, unless some are named, and what measures them."""

OTHER_PARTS = ("sizes", "clouds", "published")


def benchmark(
    names: Sequence[str] | None,
    json_path: Path | None,
    largest: int,
    folder: Path,
    parts: Sequence[str],
    *,
    keep: bool,
) -> None:
    """Measure and print the tables.

    Parameters
    ----------
    names
        Models: names of generated ones, `fandisk`, `bunny`, `rocker-arm`, or files that Blender reads; all where None.
    json_path
        Where to write everything that was measured, as JSON.
    largest
        Vertices of the largest terrain.
    folder
        Where the downloaded models are; those that are not there are left out.
    parts
        What to measure: keys of `PARTS`, and of `OTHER_PARTS` where no models are named.
    keep
        Whether to keep the tables in `docs/measured.json`, from which pages take their figures.

    Raises
    ------
    InputError
        When a model that is asked for is not there, or one that a table to be kept needs.
    """
    cases = _cases(names, folder, all_of_them=names is not None or keep)
    values: dict[str, Any] = {}
    for part in parts:
        if part in PARTS:
            wanted, run = PARTS[part]
            found = run([case for case in cases if names is not None or case.model in wanted], _say)
        elif names is not None:
            continue
        elif part == "sizes":
            found = performance.sizes([size for size in performance.SIZES if size <= largest], _say)
        elif part == "published":
            found = published_noise.run(folder.parent / "bench" / "denoising", _read, _say)
        else:
            from . import point_clouds

            found = point_clouds.run(list(point_clouds.CASES), _say)
        tables, values[part] = found
        for name, table in tables.items():
            print(f"{name}\n\n{table.markdown()}", flush=True)
        if keep:
            measured.add(tables)
        if json_path is not None:
            measured.write(json_path, json.dumps(values, indent=2) + "\n")


def _say(text: str) -> None:
    print(f"benchmark: {text} ...", file=sys.stderr, flush=True)


def _cases(names: Sequence[str] | None, folder: Path, *, all_of_them: bool) -> list[Case]:
    cases = []
    for name in names or ALL:
        path = folder / DOWNLOADED[name] if name in DOWNLOADED else Path(name)
        if path.is_file():
            cases.append(Case(name if name in DOWNLOADED else path.stem, arrays=_read(path)))
        elif name in DOWNLOADED or getattr(vars(models).get(name), "__module__", "") != models.__name__:
            if all_of_them:
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
        raise InputError(f"'{path}' is not a triangle mesh.")
    return mesh_data.read_positions(mesh), corners.reshape(-1, 3)

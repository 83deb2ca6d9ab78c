"""The public interface: exactly these names, each documented in docs/api.md, with examples that run."""

from __future__ import annotations

import doctest
import inspect
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sparse_surface import solver
from sparse_surface.benchmarks import generated_clouds, generated_models

API = Path(__file__).resolve().parents[2] / "docs" / "api.md"
LARGE = {"approximate_blocks", "reconstruct_parts"}
FUNCTIONS = LARGE | {"approximate", "denoise", "load", "reconstruct", "resample", "run_to_end", "save"}
STEPS = {f"{name}_steps" for name in {*LARGE, "approximate", "denoise", "reconstruct", "resample"}}
ERRORS = {"Cancelled", "FileFormatError", "InputError", "SettingsError", "SparseSurfaceError", "WorkerError"}
MESHES = {"Approximation", "BlockApproximation", "BlockSurface", "Representation"}
CLASSES = MESHES | {"CloudSettings", "Progress", "Reconstruction", "Report", "Settings", "ThinReconstruction"}
NAMES = FUNCTIONS | STEPS | ERRORS | CLASSES | {"FINISH", "PRESETS"}


def test_the_names_are_these() -> None:
    assert set(solver.__all__) == NAMES
    assert len(solver.__all__) == len(NAMES)
    for name in NAMES:
        assert getattr(solver, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = solver.nothing


def test_the_document_has_a_line_for_each_name() -> None:
    assert sorted(re.findall(r"^- `(\w+)", API.read_text(encoding="utf-8"), re.MULTILINE)) == sorted(NAMES)


@pytest.mark.parametrize("name", sorted(FUNCTIONS | STEPS))
def test_the_document_names_the_parameters(name: str) -> None:
    line = re.search(rf"^- `{name}\((.*?)\)`", API.read_text(encoding="utf-8"), re.MULTILINE)
    assert line is not None
    written = [part.split("=")[0].split()[0] for part in re.sub(r"\(.*?\)", "", line[1]).split(", ")]
    parameters = list(inspect.signature(getattr(solver, name)).parameters)
    own = ["representation" if parameter == "self" else parameter for parameter in parameters]
    assert [part for part in written if part != "*"] == own


@pytest.mark.parametrize("name", ["", *sorted(FUNCTIONS | CLASSES)])
def test_the_examples_run(name: str, tmp_path: Path) -> None:
    vertices, faces = generated_models.cube(6)
    cloud = generated_clouds.ball()
    known = {"np": np, "vertices": vertices, "faces": faces, "points": cloud.points, "folder": tmp_path}
    known |= {"base_vertices": cloud.base_vertices, "base_faces": cloud.base_faces}
    known["Settings"] = solver.Settings
    what = getattr(solver, name) if name else solver
    found = doctest.DocTestFinder(recurse=bool(name)).find(what, name or "solver", globs=known)
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    for example in found:
        runner.run(example)
    assert runner.summarize(verbose=False).failed == 0
    if name in (FUNCTIONS - {"load"}) | {"", "Report", "Representation", "Settings", "CloudSettings"}:
        assert runner.tries >= 2


def test_naming_a_setting_loads_no_scipy() -> None:
    """Registering the add-on imports the solver's names; SciPy takes longer to load than all of Blender's panels."""
    code = (
        "import sys; sys.path[:] = eval(sys.argv[1]); from sparse_surface.solver import Settings, InputError, Progress;"
        "print('scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, repr(sys.path)], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == "False", done.stderr

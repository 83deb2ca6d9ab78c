"""Arrows point one way, ui -> operators -> solver, and nothing tracked belongs to one machine only."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
LAYERS = ("solver", "operators", "command_line", "ui")
BLENDER_MODULES = {
    "bpy",
    "bmesh",
    "mathutils",
    "bpy_extras",
    "gpu",
    "gpu_extras",
    "blf",
    "bl_ui",
    "addon_utils",
    "idprop",
}
FORBIDDEN = {
    "solver": {"operators", "ui", "command_line", "__main__", "sparse_surface"},
    "operators": {"ui", "command_line"},
}
PACKAGE_FILES = sorted(
    [*(path for layer in LAYERS for path in (CHECKOUT / layer).rglob("*.py")), *CHECKOUT.glob("*.py")]
)


def imports(source: str) -> Iterator[tuple[int, str]]:
    """Yield (level, dotted name) of every import in `source`, wherever it stands; level 0 is absolute."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from ((0, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.module is None:
                yield from ((node.level, alias.name) for alias in node.names)
            else:
                yield node.level, node.module


def imported_layer(path: Path, level: int, name: str) -> str | None:
    """Return the layer or top-level module of this package that an import in `path` reaches; None: another's."""
    if level == 0:
        first, _, rest = name.partition(".")
        return rest.partition(".")[0] or "sparse_surface" if first == "sparse_surface" else None
    folder = path.parent
    for _ in range(level - 1):
        folder = folder.parent
    parts = [*folder.relative_to(CHECKOUT).parts, *name.split(".")]
    return parts[0]


def violations(path: Path, source: str) -> list[str]:
    """Return what `source`, standing at `path`, imports against the direction of the arrows."""
    layer = path.relative_to(CHECKOUT).parts[0]
    forbidden = {
        "solver": {"operators", "ui", "command_line", "__main__", "sparse_surface"},
        "operators": {"ui", "command_line"},
    }.get(layer, set())
    found = []
    for level, name in imports(source):
        reached = imported_layer(path, level, name)
        if reached in forbidden:
            found.append(f"{path.relative_to(CHECKOUT)} imports {'.' * level}{name}")
        if level == 0 and reached is not None:
            found.append(f"{path.relative_to(CHECKOUT)} imports {name} by its absolute name")
        if layer == "solver" and level == 0 and name.partition(".")[0] in BLENDER_MODULES:
            found.append(f"{path.relative_to(CHECKOUT)} imports {name}")
    return found


@pytest.mark.parametrize("path", PACKAGE_FILES, ids=lambda path: str(path.relative_to(CHECKOUT)))
def test_imports_follow_the_arrows(path: Path) -> None:
    assert violations(path, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("place", "source"),
    [
        ("solver/a.py", "import bpy"),
        ("solver/a.py", "def f():\n    from mathutils import Vector"),
        ("solver/a.py", "from ..operators import bridge"),
        ("solver/a.py", "from .. import ui"),
        ("operators/a.py", "from ..ui.properties import x"),
        ("operators/a.py", "from sparse_surface.solver import Settings"),
        ("solver/a.py", "import sparse_surface.ui"),
    ],
)
def test_the_check_sees_each_kind_of_wrong_import(place: str, source: str) -> None:
    assert violations(CHECKOUT / place, source)


def test_every_layer_is_there() -> None:
    assert {path.relative_to(CHECKOUT).parts[0] for path in PACKAGE_FILES} >= set(LAYERS)


IMPORT_EVERYTHING = """
import importlib, pkgutil, sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blender}:
            raise ModuleNotFoundError(f"the solver asked for {{name}}", name=name)

sys.meta_path.insert(0, Refuse())
import sparse_surface.solver as solver
for module in pkgutil.walk_packages(solver.__path__, solver.__name__ + "."):
    importlib.import_module(module.name)
leaked = sorted(name for name in sys.modules if name.partition(".")[0] in {blender})
assert not leaked, leaked
print(len([name for name in sys.modules if name.startswith("sparse_surface.solver.")]))
"""


def test_solver_imports_without_blender() -> None:
    """Also what only a function imports is caught: any import of bpy in that process fails."""
    script = IMPORT_EVERYTHING.format(blender=sorted(BLENDER_MODULES))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 10


def tracked_files() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True)
    if listing.returncode != 0:
        pytest.skip("not a git checkout")
    return [CHECKOUT / name for name in listing.stdout.decode().split("\0") if name and (CHECKOUT / name).is_file()]


# Spelled in pieces, so that this file does not name them itself.
MACHINE_PATHS = re.compile(
    "|".join(["/" + "work/", "/" + "root/", "/" + "home/[a-z]", "/" + r"tmp/\w", r"[A-Z]:\\" + "Users"])
)
ADDRESSES = re.compile(
    "|".join(["pypi" + r"\.org", "files" + r"\.pythonhosted", "registry" + r"\.npmjs", "deb" + r"\.debian"])
)


def test_tracked_files_name_no_machine_and_no_registry() -> None:
    found = []
    for path in tracked_files():
        if path.name == "LICENSE":
            continue
        try:
            text = path.read_text(encoding="utf-8")
        except UnicodeDecodeError:  # a picture
            continue
        found += [f"{path.relative_to(CHECKOUT)}: {match.group()}" for match in MACHINE_PATHS.finditer(text)]
        found += [f"{path.relative_to(CHECKOUT)}: {match.group()}" for match in ADDRESSES.finditer(text)]
    assert found == []


def test_nothing_tracked_is_a_product() -> None:
    products = {".whl", ".zip", ".blend1", ".pyc", ".npz", ".lock"}
    assert [path.name for path in tracked_files() if path.suffix in products] == []


def test_no_work_is_left_undone() -> None:
    marks = re.compile("|".join(["TO" + "DO", "FIX" + "ME", "XX" + "X", "Not" + "ImplementedError"]))
    found = [
        str(path) for path in tracked_files() if path.suffix == ".py" and marks.search(path.read_text(encoding="utf-8"))
    ]
    assert found == []

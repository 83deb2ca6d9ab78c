"""The layout of the code: floors, circles, sizes, names.

Each rule is a function from the sources, {path: text}, to sentences about what breaks it.  A rule is tested twice: on
the product, which must keep it, and on a small example that breaks it.
"""

from __future__ import annotations

import ast
import io
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import sparse_surface.solver

CHECKOUT = Path(__file__).resolve().parent.parent
LAYERS = ("solver", "operators", "command_line", "ui")
BLENDER = ["bpy", "bmesh", "mathutils", "bpy_extras", "gpu", "gpu_extras", "blf", "bl_ui", "addon_utils", "idprop"]

Sources = dict[str, str]
"""Text of each file by its path in the checkout."""

FLOORS = (
    "solver.arrays solver.atomic_files solver.errors solver.patch_methods solver.version",
    "solver.progress",
    "solver.settings",
    "solver.native",
    "solver.mesh solver.processes",
    "solver.patches solver.denoising solver.distance",
    "solver.fitting",
    "solver.surface",
    "solver.approximation solver.interchange",
    "solver.reconstruction solver.blocks",
    "solver.job",
    "solver",
    "operators.data",
    "operators.files operators.heat_map",
    "operators.preview operators.representation operators.measure",
    "operators.run",
    "operators.*",
    "operators",
    "command_line",
    "ui",
    "__init__ __main__",
)
"""Folders and modules from the ground up; each may import from those below it and from itself."""

PUBLIC = """
    approximate approximate_steps approximate_blocks approximate_blocks_steps reconstruct reconstruct_steps
    reconstruct_parts reconstruct_parts_steps denoise denoise_steps resample resample_steps save load Settings
    CloudSettings PRESETS Approximation BlockApproximation BlockSurface Reconstruction ThinReconstruction Representation
    Report Progress FINISH run_to_end SparseSurfaceError InputError SettingsError FileFormatError WorkerError Cancelled
"""

FILE_LINES, FUNCTION_LINES = 400, 45
PRODUCT_LINES, IMPORTS_IN_FUNCTIONS, IN_SOLVER = 18_500, 60, 20

VIOLATIONS = CHECKOUT / "tests" / "known_violations.txt"
KNOWN = set(VIOLATIONS.read_text(encoding="utf-8").splitlines())
"""What is still being mended, a sentence a line.  The list only gets shorter."""


def product() -> Sources:
    """Return the sources of the extension; benchmarks and scripts are not part of it."""
    files = [*(path for layer in LAYERS for path in (CHECKOUT / layer).rglob("*.py")), *CHECKOUT.glob("*.py")]
    return {path.relative_to(CHECKOUT).as_posix(): path.read_text(encoding="utf-8") for path in sorted(files)}


# ------------------------------------------------------------------------------------------------------------- imports


def module_of(path: str) -> str:
    """Return the dotted name of a file: `solver.mesh.normals`; a folder's `__init__.py` has the folder's name."""
    return path.removesuffix(".py").replace("/", ".").removesuffix(".__init__")


def imports(path: str, text: str) -> Iterator[tuple[str, str | None]]:
    """Yield (module, name) of every import in a file, wherever it stands; names of this package lose their dots."""
    package = module_of(path) if path.endswith("/__init__.py") else module_of(path).rpartition(".")[0]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from ((alias.name, None) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module or "", None
        elif isinstance(node, ast.ImportFrom):
            parts = package.split(".") if package and package != "__init__" else []
            base = [*parts[: len(parts) - node.level + 1], *(node.module or "").split(".")]
            yield from ((".".join(filter(None, base)), alias.name) for alias in node.names)


def arrows(sources: Sources) -> dict[str, set[str]]:
    """Return which modules of this package each module imports."""
    modules = {module_of(path) for path in sources}
    found: dict[str, set[str]] = {}
    for path, text in sources.items():
        reached = found.setdefault(module_of(path), set())
        for module, name in imports(path, text):
            if name is not None:
                whole = f"{module}.{name}" if module else name
                reached.add(whole if whole in modules or not module else module)
        reached.discard(module_of(path))
    return found


def place(module: str) -> str:
    """Return the folder or module that stands on a floor: two levels of the solver and of the operators."""
    parts = module.split(".")
    if parts[0] == "operators" and len(parts) == 2 and not (CHECKOUT / "operators" / parts[1]).is_dir():
        return "operators.*"
    return ".".join(parts[:2]) if parts[0] in ("solver", "operators") else parts[0]


def upward_imports(sources: Sources) -> list[str]:
    """What is imported from above, from elsewhere on the same floor, or from what stands on no floor."""
    floor = {name: height for height, names in enumerate(FLOORS) for name in names.split()}
    found = []
    for module, reached in arrows(sources).items():
        if place(module) not in floor:
            found.append(f"{module} stands on no floor")
            continue
        for other in reached:
            same = place(module) == place(other) != "operators.*"
            if not same and floor.get(place(other), len(FLOORS)) >= floor[place(module)]:
                found.append(f"{module} imports {other}, upwards")
    return found


def foreign_imports(sources: Sources) -> list[str]:
    """Imports of this package by its absolute name, and of Blender in the solver."""
    found = []
    for path, text in sources.items():
        for module, name in imports(path, text):
            first = module.partition(".")[0]
            if name is None and first == "sparse_surface":
                found.append(f"{path} imports {module} by its absolute name")
            if name is None and first in BLENDER and path.startswith("solver/"):
                found.append(f"{path} imports {module}")
    return found


def circles(sources: Sources) -> list[str]:
    """Modules that import each other, directly or through others; and places of the house that do."""
    between = arrows(sources)
    places: dict[str, set[str]] = {}
    for module, reached in between.items():
        places.setdefault(place(module), set()).update({place(other) for other in reached} - {place(module)})
    return [f"circle: {', '.join(circle)}" for graph in (between, places) for circle in strong_components(graph)]


def strong_components(graph: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of nodes that can be reached from each other, sorted."""
    reachable = {}
    for start in graph:
        seen, ahead = set(), [start]
        while ahead:
            new = graph.get(ahead.pop(), set()) - seen
            seen |= new
            ahead += new
        reachable[start] = seen
    found = {tuple(sorted(b for b in reachable[a] if a in reachable.get(b, ()))) for a in graph}
    return [list(circle) for circle in sorted(found) if circle]


def imports_in_functions(sources: Sources) -> list[str]:
    """Say where more imports stand inside functions than the whole product may have."""
    count: Counter[str] = Counter()
    for path, text in sources.items():
        inner = {
            node.lineno
            for function in ast.walk(ast.parse(text))
            if isinstance(function, ast.FunctionDef)
            for node in ast.walk(function)
            if isinstance(node, ast.Import | ast.ImportFrom)
        }
        count[path] += len(inner)
    if count.total() <= IMPORTS_IN_FUNCTIONS:
        return []
    most = ", ".join(f"{path} {number}" for path, number in count.most_common(8))
    print(f"{count.total()} imports stand inside functions: {most}, ...")
    return [f"more than {IMPORTS_IN_FUNCTIONS} imports stand inside functions"]


# --------------------------------------------------------------------------------------------------------------- sizes


def long_files(sources: Sources) -> list[str]:
    """Files that are two."""
    return [f"{path} is too long" for path, text in sources.items() if len(text.splitlines()) > FILE_LINES]


def code_lines(text: str) -> set[int]:
    """Return the numbers of the lines that hold code, not only comments or nothing."""
    blank = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    return {line for token in tokens if token.type not in blank for line in range(token.start[0], token.end[0] + 1)}


def long_functions(sources: Sources) -> list[str]:
    """Functions that do too much; signatures count, docstrings and comments do not."""
    found = []
    for path, text in sources.items():
        lines = code_lines(text)
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                own = lines & set(range(node.lineno, (node.end_lineno or 0) + 1))
                if ast.get_docstring(node) is not None:
                    own -= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
                if len(own) > FUNCTION_LINES:
                    found.append(f"{path}: {node.name} is too long")
    return found


def large_product(sources: Sources) -> list[str]:
    """Say that the product as a whole is too large."""
    total = sum(len(text.splitlines()) for text in sources.values())
    print(f"The product has {total} lines.")
    return [f"the product has more than {PRODUCT_LINES} lines"] if total > PRODUCT_LINES else []


def crowded_solver(sources: Sources) -> list[str]:
    """Say that too many folders and modules lie directly in the solver."""
    there = {path.split("/")[1] for path in sources if path.startswith("solver/")} - {"__init__.py"}
    return [f"more than {IN_SOLVER} folders and modules lie in solver/"] if len(there) > IN_SOLVER else []


# --------------------------------------------------------------------------------------------------------------- names


def not_operators(sources: Sources) -> list[str]:
    """Files directly in operators/ that are not one operator each, named as Blender knows it."""
    found = []
    for path, text in sources.items():
        if re.fullmatch(r"operators/(?!__init__)\w+\.py", path):
            names = re.findall(r'^    bl_idname(?:: str)? = "(.*)"$', text, re.MULTILINE)
            if names != [f"sparse_surface.{Path(path).stem}"]:
                found.append(f"{path} is not one operator of that name")
    return found


def undocumented_modules(sources: Sources, page: str) -> list[str]:
    """Modules that docs/architecture.md does not name, as often as the name occurs."""
    named = Counter(re.split(r"[./]", name.removesuffix(".py"))[-1] for name in re.findall(r"`([\w./]+)`", page))
    stems = Counter(Path(path).stem for path in sources if not path.endswith("__init__.py"))
    return [f"docs/architecture.md does not name {stem}" for stem in stems if named[stem] < stems[stem]]


def unlisted_names(names: list[str]) -> list[str]:
    """How the solver's public names differ from the list above."""
    return [f"{name} is public in one of code and list" for name in sorted(set(names) ^ set(PUBLIC.split()))]


# ----------------------------------------------------------------------------------------------------------- the tests

RULES: tuple[tuple[Callable[[Sources], list[str]], Sources], ...] = (
    (upward_imports, {"solver/mesh/a.py": "def f():\n    from ..fitting import batch"}),
    (upward_imports, {"solver/a.py": "from .. import ui"}),
    (upward_imports, {"solver/mesh/a.py": "if TYPE_CHECKING:\n    from ...operators.data import b"}),
    (upward_imports, {"operators/a.py": "from .b import C", "operators/b.py": ""}),
    (upward_imports, {"operators/data/a.py": "from ...ui.panels import b"}),
    (upward_imports, {"command_line/a.py": "from ..benchmarks import command"}),
    (upward_imports, {"solver/new/a.py": ""}),
    (foreign_imports, {"operators/a.py": "from sparse_surface.solver import Settings"}),
    (foreign_imports, {"solver/a.py": "import sparse_surface.ui"}),
    (foreign_imports, {"solver/a.py": "def f():\n    from mathutils import Vector"}),
    (circles, {"ui/a.py": "from .b import x", "ui/b.py": "if TYPE_CHECKING:\n    from . import a"}),
    (circles, {"ui/a.py": "from . import b", "ui/b.py": "from . import c", "ui/c.py": "from .a import f"}),
    (circles, {"solver/mesh/a.py": "from ..patches.b import x", "solver/patches/c.py": "from ..mesh.d import y"}),
    (imports_in_functions, {"ui/a.py": "def f():\n" + "    import os\n" * (IMPORTS_IN_FUNCTIONS + 1)}),
    (long_files, {"ui/a.py": "\n" * (FILE_LINES + 1)}),
    (long_functions, {"ui/a.py": "class A:\n    def f(self):\n" + "        f()\n" * FUNCTION_LINES}),
    (large_product, {"ui/a.py": "\n" * PRODUCT_LINES, "ui/b.py": "\n"}),
    (crowded_solver, {f"solver/{name}.py": "" for name in range(IN_SOLVER + 1)}),
    (not_operators, {"operators/a.py": 'class B(Operator):\n    bl_idname = "sparse_surface.b"'}),
    (not_operators, {"operators/helpers.py": ""}),
)
"""Each rule with sources that break it."""


@pytest.mark.parametrize("rule", dict.fromkeys(rule for rule, _ in RULES), ids=lambda rule: rule.__name__)
def test_the_product_keeps_the_rule(rule: Callable[[Sources], list[str]]) -> None:
    assert sorted(set(rule(product())) - KNOWN) == []


@pytest.mark.parametrize(("rule", "sources"), RULES)
def test_the_rule_sees_what_breaks_it(rule: Callable[[Sources], list[str]], sources: Sources) -> None:
    assert len(rule(sources)) == 1


def test_what_is_allowed_breaks_no_rule() -> None:
    short = f'def f():\n    """One\n    two."""\n{"    # why" + chr(10)}{"    f()" + chr(10) * 2}' * 3
    sources = {
        "solver/mesh/a.py": short + "from . import b\nfrom .b import x\nfrom ..errors import E\nimport numpy",
        "solver/mesh/b.py": "def f():\n" + "    f()\n" * (FUNCTION_LINES - 1),
        "operators/a.py": 'from ..solver import Settings\nclass A:\n    bl_idname = "sparse_surface.a"',
        "ui/a.py": "import bpy\n" + "\n" * (FILE_LINES - 1),
    }
    assert [said for rule, _ in RULES for said in rule(sources)] == []


def test_every_module_stands_in_the_architecture() -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    assert sorted(set(undocumented_modules(product(), page)) - KNOWN) == []


def test_a_module_that_the_page_leaves_out_is_seen() -> None:
    sources = dict.fromkeys(["ui/a.py", "ui/b.py", "operators/b.py", "ui/c.py", "ui/__init__.py"], "")
    assert undocumented_modules(sources, "`a`, `ui/b.py`, `solver.c`") == ["docs/architecture.md does not name b"]


def test_public_names_are_those_of_the_list() -> None:
    assert sorted(set(unlisted_names(sparse_surface.solver.__all__)) - KNOWN) == []
    assert unlisted_names([*PUBLIC.split()[1:], "x"]) == [
        f"{name} is public in one of code and list" for name in ("approximate", "x")
    ]


def test_every_place_of_the_floors_is_there() -> None:
    assert {place(module_of(path)) for path in product()} == {name for names in FLOORS for name in names.split()}


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
    script = IMPORT_EVERYTHING.format(blender=sorted(BLENDER))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd="/")
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) >= 10

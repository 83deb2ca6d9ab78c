"""What operators that run the solver share."""

from __future__ import annotations

import ast
import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from bl_ext.user_default.sparse_surface import operators
from bl_ext.user_default.sparse_surface.operators.run import bytecode, preloading
from bl_ext.user_default.sparse_surface.operators.run.control import Run
from bl_ext.user_default.sparse_surface.operators.run.operator import SolverOperator
from bl_ext.user_default.sparse_surface.operators.run.session import session

sys.path.insert(0, str(Path(__file__).parent))
import scenes

RUN = ("approximate.py", "run/operator.py", "run/control.py", "preview/object.py")
"""The modules that Blender goes through between the button and the result and that import inside functions."""


@pytest.mark.parametrize("missing", ["tasks", "make_objects"])
def test_an_operator_without_what_it_must_say_is_refused(missing: str) -> None:
    methods = {name: lambda *_: ([], []) for name in ("tasks", "make_objects") if name != missing}
    with pytest.raises(TypeError, match=f"no method '{missing}'"):
        type("Lacking", (SolverOperator,), methods)


def test_each_operator_is_a_file_of_its_name() -> None:
    folder = Path(operators.__file__).parent
    assert sorted(operators.OPERATORS) == sorted(each.stem for each in folder.glob("*.py") if each.stem != "__init__")
    for operator, name in zip(operators.operator_classes(), operators.OPERATORS, strict=True):
        assert operator.bl_idname == f"sparse_surface.{name}"


def imports_in_functions(path: Path, package: str) -> set[str]:
    """Return the modules that a file's functions import."""
    functions = [node for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.FunctionDef)]
    found = [node for each in functions for node in ast.walk(each) if isinstance(node, ast.ImportFrom)]
    return {importlib.util.resolve_name("." * node.level + (node.module or ""), package) for node in found}


def test_pressing_the_button_loads_no_module_after_preloading(run_bpy) -> None:
    folder, root = Path(operators.__file__).parent, f"{scenes.EXTENSION}.operators"
    packages = {name: f"{root}.{Path(name).parent.name}".rstrip(".") for name in RUN}
    wanted = set().union(*(imports_in_functions(folder / name, packages[name]) for name in RUN))
    assert len(wanted) >= 4
    done = run_bpy(
        f"""
import sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
import scenes
scenes.enable_extension()
from importlib import import_module
for name in {preloading._NEEDED!r}:
    import_module(name, "{root}.run")
print("missing", sorted({wanted!r} - set(sys.modules)))
"""
    )
    assert "missing []" in done.stdout, done.stdout + done.stderr


def test_a_run_has_the_processors_to_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    """The child of the next run waits with its loading, although a panel asked for it right before the click."""
    waiting = {preloading._load_next}
    timers = SimpleNamespace(is_registered=waiting.__contains__, unregister=waiting.remove)
    monkeypatch.setattr(preloading, "bpy", SimpleNamespace(app=SimpleNamespace(timers=timers)))
    monkeypatch.setattr(session, "current", None)
    session.start(Run([]))
    assert not waiting


def test_modules_are_translated_once_after_an_installation(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Not again while there is bytecode, nor where nothing can be written; what still works ends with the add-on."""
    solver = tmp_path / "solver"
    (solver / "approximation").mkdir(parents=True)
    loaded = solver / "approximation" / "approximate.py"
    loaded.write_text("DONE = True\n")
    monkeypatch.setattr(bytecode, "SOLVER", solver)
    monkeypatch.setattr(bytecode, "_LOADED_BY_CHILDREN", loaded)
    assert bytecode.is_needed()
    bytecode.begin(preloading.python_command())
    assert bytecode._process is not None
    assert bytecode._process.wait(60.0) == 0
    assert Path(importlib.util.cache_from_source(str(loaded))).exists()
    assert not bytecode.is_needed()
    bytecode.stop()
    monkeypatch.setattr(bytecode, "_TRANSLATE", "import time; time.sleep(60)")
    bytecode.begin(preloading.python_command())
    process = bytecode._process
    preloading.unregister()
    assert process.poll() is not None
    assert bytecode._process is None

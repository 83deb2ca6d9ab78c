"""The script of every child process: loads this folder as a package of its own name and runs one of its modules.

It is started by its path because the package's name is not importable everywhere: Blender knows an
extension as ``bl_ext...``, which exists only inside Blender.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

PACKAGE = "sparse_surface_solver"


def load_solver(folder: Path) -> ModuleType:
    """Load `folder` as the package `PACKAGE` and return it; once loaded, `import` finds it by that name."""
    if PACKAGE not in sys.modules:
        spec = importlib.util.spec_from_file_location(
            PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
        )
        if spec is None or spec.loader is None:
            raise ImportError(f"{folder} is no package")
        package = importlib.util.module_from_spec(spec)
        sys.modules[PACKAGE] = package
        spec.loader.exec_module(package)
    return sys.modules[PACKAGE]


def main(text: str) -> int:
    """Carry out the order that `child.start_child` wrote; the owner's module search path comes first of all."""
    order = json.loads(text)
    sys.path[:] = order["module_search_path"]
    load_solver(Path(__file__).resolve().parent)
    status: int = importlib.import_module(f"{PACKAGE}.{order['module']}").serve(*order["arguments"])
    return status


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

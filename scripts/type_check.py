"""Run mypy on the package under its real name.

The checkout may lie in a folder of any name, and mypy takes a package's name from its folder; a link named
`sparse_surface` in a folder of its own gives every module the name that it is imported by.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent


def main() -> int:
    link = CHECKOUT / ".mypy_cache" / "path" / "sparse_surface"
    link.parent.mkdir(parents=True, exist_ok=True)
    if not link.exists():
        link.symlink_to(CHECKOUT, target_is_directory=True)
    packages = [
        name
        for name in ("solver", "operators", "command_line", "ui", "benchmarks")
        if any((CHECKOUT / name).glob("*.py"))
    ]
    modules = sorted(path.stem for path in CHECKOUT.glob("*.py") if path.stem != "__init__")
    arguments = [
        *(argument for name in packages for argument in ("-p", f"sparse_surface.{name}")),
        *(argument for name in modules for argument in ("-m", f"sparse_surface.{name}")),
    ]
    environment = {**os.environ, "MYPYPATH": str(link.parent)}
    command = [sys.executable, "-m", "mypy", "--config-file", str(CHECKOUT / "pyproject.toml"), *arguments]
    return subprocess.run([*command, *sys.argv[1:]], cwd=link.parent, env=environment).returncode


if __name__ == "__main__":
    sys.exit(main())

"""Make or refresh a virtual environment from the pinned versions in requirements/.

Runs on the standard library alone, by the Python that the environment is to have:

    python scripts/environment.py .venv test development solver blender-4.5 --editable

Nothing is done, in a few milliseconds, when the environment was made from the same files by the same Python.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tomllib
import venv
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
REQUIREMENTS = CHECKOUT / "requirements"
STAMP = "environment.json"


def blender_for(python: tuple[int, int]) -> str:
    """Return the newest long-term Blender that runs on this Python, as the name of its requirements file."""
    return "blender-5.2" if python >= (3, 13) else "blender-4.5"


def python_of(folder: Path) -> Path:
    return folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")


def recipe(requirements: list[Path], constraints: list[Path], editable: bool) -> dict[str, object]:
    """Everything that decides what is installed; equal recipes give equal environments."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))
    return {
        "python": sys.version,
        "requirements": {path.name: path.read_text(encoding="utf-8") for path in requirements},
        "constraints": {path.name: path.read_text(encoding="utf-8") for path in constraints},
        "checkout": [str(CHECKOUT), project["project"], project["tool"]["setuptools"]] if editable else None,
    }


def recipe_of(folder: Path) -> dict[str, object]:
    """Return the recipe that an environment was made by, empty if it has none or is broken."""
    try:
        made_by = json.loads((folder / STAMP).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return dict(made_by) if python_of(folder).exists() else {}


def make(folder: Path, requirements: list[Path], constraints: list[Path], wanted: dict[str, object]) -> None:
    """Bring an environment from the recipe it has to the one that is wanted."""
    present = recipe_of(folder)
    (folder / STAMP).unlink(missing_ok=True)
    if present.get("python") != wanted["python"]:
        venv.EnvBuilder(clear=True, with_pip=True, symlinks=os.name != "nt").create(folder)
    pip = [str(python_of(folder)), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    if [present.get(key) for key in ("requirements", "constraints")] != [wanted["requirements"], wanted["constraints"]]:
        # All files at once, so that a conflict between them is an error.
        named = [f"--requirement={path}" for path in requirements] + [f"--constraint={path}" for path in constraints]
        subprocess.run([*pip, *named], check=True)
    if wanted["checkout"] is not None:
        subprocess.run([*pip, "--no-deps", "--no-build-isolation", f"--editable={CHECKOUT}"], check=True, cwd=CHECKOUT)
    (folder / STAMP).write_text(json.dumps(wanted, indent=1), encoding="utf-8")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="+", help="files of requirements/ without .txt; `blender` takes the fitting one")
    parser.add_argument("--constraint", action="append", default=[], metavar="NAME", help="pins without installing")
    parser.add_argument("--editable", action="store_true", help="install this checkout as sparse_surface too")
    options = parser.parse_args(arguments)
    names = [blender_for(sys.version_info[:2]) if name == "blender" else name for name in options.names]
    requirements = [REQUIREMENTS / f"{name}.txt" for name in names]
    constraints = [REQUIREMENTS / f"{name}.txt" for name in options.constraint]
    wanted = recipe(requirements, constraints, options.editable)
    if recipe_of(options.folder) == wanted:
        return 0
    print(f"Setting up {options.folder} with Python {sys.version.split()[0]}: {', '.join(names)} ...", flush=True)
    try:
        make(options.folder, requirements, constraints, wanted)
    except subprocess.CalledProcessError as failure:
        print(f"Setting up {options.folder} failed: {' '.join(failure.cmd[2:])}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

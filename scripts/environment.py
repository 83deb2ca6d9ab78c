"""Make or refresh a virtual environment from the pinned versions in requirements/.

Runs on the standard library alone, by the Python that the environment is to have:

    python scripts/environment.py .venv development solver blender-4.5 --editable

Nothing is done, in a few milliseconds, when the environment was made from the same files by the same Python.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import subprocess
import sys
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


def recipe(requirements: list[Path], editable: bool) -> dict[str, object]:
    """Everything that decides what is installed; equal recipes give equal environments."""
    files = [*requirements, *([CHECKOUT / "pyproject.toml"] if editable else [])]
    return {
        "python": sys.version,
        "checkout": str(CHECKOUT) if editable else None,
        "files": {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files},
    }


def is_fresh(folder: Path, wanted: dict[str, object]) -> bool:
    try:
        return bool(json.loads((folder / STAMP).read_text()) == wanted) and python_of(folder).exists()
    except (OSError, ValueError):
        return False


def install(folder: Path, requirements: list[Path], editable: bool) -> None:
    """Create the environment anew; pip resolves all files at once, so that a conflict is an error."""
    venv.EnvBuilder(clear=True, with_pip=True, symlinks=os.name != "nt").create(folder)
    python = str(python_of(folder))
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    arguments = [argument for path in requirements for argument in ("--requirement", str(path))]
    subprocess.run([*pip, *arguments], check=True)
    if editable:
        subprocess.run(
            [*pip, "--no-deps", "--no-build-isolation", "--editable", str(CHECKOUT)], check=True, cwd=CHECKOUT
        )


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="+", help="files of requirements/ without .txt; `blender` takes the fitting one")
    parser.add_argument("--editable", action="store_true", help="install this checkout as sparse_surface too")
    options = parser.parse_args(arguments)
    names = [blender_for(sys.version_info[:2]) if name == "blender" else name for name in options.names]
    requirements = [REQUIREMENTS / f"{name}.txt" for name in names]
    wanted = recipe(requirements, options.editable)
    if is_fresh(options.folder, wanted):
        return 0
    print(f"Setting up {options.folder} with Python {sys.version.split()[0]}: {', '.join(names)} ...", flush=True)
    try:
        install(options.folder, requirements, options.editable)
    except subprocess.CalledProcessError as failure:
        print(f"Setting up {options.folder} failed: {' '.join(failure.cmd[2:])}", file=sys.stderr)
        return 1
    (options.folder / STAMP).write_text(json.dumps(wanted, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())

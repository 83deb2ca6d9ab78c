"""Build and validate the extension zips in dist/ with Blender's own tools.

There is one for each platform and generation of Python (Blender 4.2 to 5.0, and from 5.1 on), and one without wheels.
One with the wheels of both generations, which is twice as large, is built when its platform alone is named.

    python scripts/build_extension.py                             all of them
    python scripts/build_extension.py linux-x64-cp311 nowheels    some of them
    python scripts/build_extension.py linux-x64                   one for both generations

The same sources and wheels give the same bytes.
"""

from __future__ import annotations

import argparse
import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
import zipfile
from pathlib import Path
from platform import machine as machine_name

from build_native import TARGETS, NativeBuildError, build_for
from extension_wheels import CHECKOUT, PLATFORMS, WheelError, fetch, fetch_platform

MANIFEST = "blender_manifest.toml"
WITHOUT_WHEELS = "nowheels"
FOLDERS = ("command_line", "operators", "presets", "solver", "ui")
FILES = ("CHANGELOG.md", "LICENSE", "py.typed")
KERNEL = Path("solver", "native", "built")  # the compiled kernel, another one on each platform; all without wheels
GENERATIONS = {"cp311": ("4.2.0", "5.1.0"), "cp313": ("5.1.0", None)}
"""The first Blender with each Python, and the first that has another one again."""

LARGEST_ZIP = 60_000_000
DATE = (1980, 1, 1, 0, 0, 0)  # the earliest that a zip can hold


class BuildError(Exception):
    """A zip could not be built or is not valid."""


def package_files() -> list[Path]:
    """Return what belongs to the package on every platform, relative to the checkout, in order."""
    inside = [path for folder in FOLDERS for path in (CHECKOUT / folder).rglob("*") if path.is_file()]
    found = [
        path.relative_to(CHECKOUT) for path in [*inside, *CHECKOUT.glob("*.py"), *(CHECKOUT / name for name in FILES)]
    ]
    kept = [path for path in found if not {"__pycache__", KERNEL.name} & {*path.parts}]
    return sorted(path for path in kept if path.suffix not in (".c", ".h") and not path.name.startswith("."))


def manifest_source() -> str:
    return (CHECKOUT / MANIFEST).read_text(encoding="utf-8")


def manifest_text(platform: str, wheels: list[str], python: str | None = None) -> str:
    """Return the manifest of one zip: the checked-in one with platform, wheels and the Blenders with the Python."""
    if not wheels:
        return manifest_source()
    lines = [f'platforms = ["{platform}"]', "wheels = [", *(f'    "./wheels/{name}",' for name in wheels), "]"]
    top, first_table, tables = manifest_source().partition("\n[permissions]\n")
    if python is not None:
        first, end = GENERATIONS[python]
        versions = f'blender_version_min = "{first}"' + (f'\nblender_version_max = "{end}"' if end else "")
        top = re.sub(r'blender_version_min = ".*"', versions, top)
    return "\n".join([top, *lines, first_table + tables])


def parts_of(kind: str) -> tuple[str, str | None]:
    """Return platform and Python of a kind of zip; None where it has the wheels of all."""
    platform, dash, python = kind.rpartition("-")
    return (platform, python) if dash and python in GENERATIONS else (kind, None)


def kinds_by_default() -> list[str]:
    """Return the kinds of zips that people download."""
    return [*(f"{name}-{python}" for name, each in PLATFORMS.items() for python in each.pythons), WITHOUT_WHEELS]


def kernels(platform: str) -> dict[Path, Path]:
    """Return the compiled kernels by their places in a zip: the platform's own, or without wheels that of each."""
    if platform == WITHOUT_WHEELS:
        return {KERNEL / name / path.name: path for name, path in ((each, build_for(each)) for each in TARGETS)}
    own = build_for(platform)
    return {KERNEL / own.name: own}


def stage(folder: Path, kind: str, wheels: list[Path]) -> None:
    """Copy the package into a new folder, with compiled kernels and the manifest of its zip."""
    for path in package_files():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CHECKOUT / path, folder / path)
    for place, kernel in kernels(parts_of(kind)[0]).items():
        (folder / place).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(kernel, folder / place)
    (folder / "wheels").mkdir()
    for wheel in wheels:
        shutil.copyfile(wheel, folder / "wheels" / wheel.name)
    platform, python = parts_of(kind)
    text = manifest_text(platform, [wheel.name for wheel in wheels], python)
    (folder / MANIFEST).write_text(text, encoding="utf-8")


def settle(path: Path) -> None:
    """Repack a zip in a fixed order with a fixed date, so that the same sources give the same bytes."""
    draft = path.with_suffix(".draft")
    with zipfile.ZipFile(path) as built, zipfile.ZipFile(draft, "w", compresslevel=9) as settled:
        for name in sorted(built.namelist(), key=lambda name: (name != MANIFEST, name)):
            entry = zipfile.ZipInfo(name, date_time=DATE)
            entry.compress_type = built.getinfo(name).compress_type
            entry.external_attr = 0o644 << 16
            entry.create_system = 3
            settled.writestr(entry, built.read(name))
    draft.replace(path)


def blender_extension_tool() -> Path:
    """Return the script of Blender's extension tools that lies in the bpy package, without importing bpy."""
    found = importlib.util.find_spec("bpy")
    if found is None or found.origin is None:
        raise BuildError("bpy is not installed here; `make venv` installs it.")
    tools = sorted(Path(found.origin).parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    if not tools:
        raise BuildError("This bpy comes without the extension tools.")
    return tools[-1]


def run_tool(*arguments: str) -> None:
    command = [sys.executable, "-I", str(blender_extension_tool()), *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise BuildError(f"Blender's `extension {arguments[0]}` failed:\n{done.stdout}{done.stderr}")


def zip_name(kind: str) -> str:
    version = tomllib.loads(manifest_source())["version"]
    platform, python = parts_of(kind)
    blender = f"-blender_{GENERATIONS[python][0].removesuffix('.0')}" if python else ""
    return f"sparse_surface-{version}-{platform.replace('-', '_')}{blender}.zip"


def this_platform() -> str:
    """Return Blender's name for this platform, or `nowheels` if no wheels exist for it."""
    system = {"linux": "linux", "win32": "windows", "darwin": "macos"}.get(sys.platform, sys.platform)
    machine = {"x86_64": "x64", "amd64": "x64", "aarch64": "arm64"}.get(machine_name().lower(), machine_name().lower())
    name = f"{system}-{machine}"
    return name if name in PLATFORMS else WITHOUT_WHEELS


def build(kind: str, folder: Path) -> Path:
    """Build and validate one zip.

    Raises
    ------
    BuildError, NativeBuildError, WheelError
        With the builder's or the validator's own words.
    """
    platform, python = parts_of(kind)
    wheels: list[Path] = []
    if platform != WITHOUT_WHEELS:
        wheels = fetch_platform(platform) if python is None else fetch(platform, python)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".building_", dir=folder) as temporary:
        stage(Path(temporary) / "package", kind, wheels)
        draft = Path(temporary) / zip_name(kind)
        run_tool("build", "--source-dir", str(Path(temporary) / "package"), "--output-filepath", str(draft))
        settle(draft)
        run_tool("validate", str(draft))
        if python is not None and draft.stat().st_size > LARGEST_ZIP:
            raise BuildError(
                f"{draft.name} has {draft.stat().st_size / 1e6:.0f} MB; at most {LARGEST_ZIP / 1e6:.0f} are due."
            )
        return draft.replace(folder / draft.name)


def describe(path: Path) -> str:
    with zipfile.ZipFile(path) as file:
        names = file.namelist()
    pythons = sorted({match for name in names for match in re.findall(r"-(cp\d+)-", name)})
    wheels = (
        f"{sum(name.endswith('.whl') for name in names)} wheels for {', '.join(pythons)}" if pythons else "no wheels"
    )
    return f"{path}  {path.stat().st_size / 1e6:6.1f} MB  {len(names)} files, {wheels}, valid"


def main(arguments: list[str] | None = None) -> int:
    kinds = [*kinds_by_default(), *PLATFORMS]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", choices=[[], *kinds], metavar="KIND", help=", ".join(kinds))
    parser.add_argument("--output", type=Path, default=CHECKOUT / "dist", metavar="FOLDER", help="default: dist")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    try:
        for kind in options.kinds or kinds_by_default():
            print(describe(build(kind, options.output)), flush=True)
    except (BuildError, NativeBuildError, WheelError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"done in {time.perf_counter() - start:.0f} s")
    return 0


if __name__ == "__main__":
    sys.exit(main())

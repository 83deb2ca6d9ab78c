"""Fetch the wheels that go into the extension zips, for platforms other than this one too.

Versions and hashes stand in requirements/extension-cp*.txt; what is already in wheels/ with a pinned hash is not
fetched again.  `python scripts/extension_wheels.py --pin` updates the hashes after a version was changed there.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
CACHE = CHECKOUT / "wheels"


@dataclass(frozen=True)
class Platform:
    """A platform by Blender's name, its wheel tags and the Pythons that Blender has there."""

    tags: tuple[str, ...]
    pythons: tuple[str, ...] = ("cp311", "cp313")


PLATFORMS = {
    "linux-x64": Platform(("manylinux2014_x86_64", "manylinux_2_17_x86_64")),
    "windows-x64": Platform(("win_amd64",)),
    "macos-arm64": Platform(("macosx_12_0_arm64",)),
    # Blender left Intel Macs with 5.0, before it went to Python 3.13.
    "macos-x64": Platform(("macosx_10_13_x86_64", "macosx_10_9_x86_64"), pythons=("cp311",)),
}


class WheelError(Exception):
    """A wheel could not be had, or is not the pinned one."""


def requirements_file(python: str) -> Path:
    return CHECKOUT / "requirements" / f"extension-{python}.txt"


def pins(python: str) -> dict[str, str]:
    """Return package name -> version."""
    return dict(re.findall(r"^([\w-]+)==([\w.]+)", requirements_file(python).read_text(), re.MULTILINE))


def pinned_hashes(python: str) -> set[str]:
    return set(re.findall(r"--hash=sha256:([0-9a-f]{64})", requirements_file(python).read_text()))


def sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def wheels_in(folder: Path, python: str) -> list[Path]:
    """Return the folder's wheels in order; all have pinned names, versions and hashes, or the list is empty."""
    found = []
    hashes = pinned_hashes(python)
    for name, version in sorted(pins(python).items()):
        candidates = sorted(folder.glob(f"{name.replace('-', '_')}-{version}-*.whl"))
        if len(candidates) != 1 or sha256(candidates[0]) not in hashes:
            return []
        found += candidates
    return found


def download(platform: str, python: str, folder: Path, *arguments: str) -> None:
    options = ["--quiet", "--disable-pip-version-check", "--no-deps", "--only-binary=:all:", "--implementation=cp"]
    tags = [f"--platform={tag}" for tag in PLATFORMS[platform].tags]
    version = f"--python-version={python[2]}.{python[3:]}"
    command = [sys.executable, "-m", "pip", "download", *options, *tags, version, f"--dest={folder}", *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        errors = [line for line in done.stderr.splitlines() if "WARNING" not in line]
        raise WheelError(f"The wheels of {python} for {platform} could not be fetched:\n" + "\n".join(errors))


def fetch(platform: str, python: str) -> list[Path]:
    """Return the wheels for a platform and Python, from the cache or fetched.

    Raises
    ------
    WheelError
        When a wheel cannot be fetched or its hash is not pinned.
    """
    folder = CACHE / f"{platform}-{python}"
    found = wheels_in(folder, python)
    if not found:
        print(f"Fetching wheels: {platform}, {python} ...", flush=True)
        for stale in folder.glob("*.whl"):
            stale.unlink()
        download(platform, python, folder, "--require-hashes", f"--requirement={requirements_file(python)}")
        found = wheels_in(folder, python)
    if not found:
        raise WheelError(
            f"What was fetched for {platform}, {python} is not what {requirements_file(python).name} pins."
        )
    return found


def fetch_platform(platform: str) -> list[Path]:
    """Return all wheels of one platform's zip, each file name once, in order."""
    wheels = {wheel.name: wheel for python in PLATFORMS[platform].pythons for wheel in fetch(platform, python)}
    return [wheels[name] for name in sorted(wheels)]


def pin(python: str) -> None:
    """Fetch the versions named in a requirements file for every platform and write down the hashes."""
    platforms = [name for name, platform in PLATFORMS.items() if python in platform.pythons]
    hashes: dict[str, set[str]] = {name: set() for name in pins(python)}
    with tempfile.TemporaryDirectory() as temporary:
        for platform in platforms:
            folder = Path(temporary) / platform
            download(platform, python, folder, *(f"{name}=={version}" for name, version in pins(python).items()))
            for name in hashes:
                (wheel,) = folder.glob(f"{name.replace('-', '_')}-*.whl")
                hashes[name].add(sha256(wheel))
    lines = []
    for name, version in pins(python).items():
        options = [f"--hash=sha256:{value}" for value in sorted(hashes[name])]
        lines.append(" \\\n    ".join([f"{name}=={version}", *options]))
    requirements_file(python).write_text("\n".join(lines) + "\n")


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pin", action="store_true", help="update the hashes of the named versions")
    parser.add_argument("platforms", nargs="*", choices=[[], *PLATFORMS], metavar="PLATFORM", help=", ".join(PLATFORMS))
    options = parser.parse_args(arguments)
    try:
        if options.pin:
            for python in ("cp311", "cp313"):
                pin(python)
        for platform in options.platforms or PLATFORMS:
            fetch_platform(platform)
    except WheelError as error:
        print(error, file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

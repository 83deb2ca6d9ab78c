"""Make a release in one command: version, changelog, library, zips, documents, checksums, commit and tag.

    python scripts/release.py 0.2.0

Everything lands in dist/release-0.2.0.  A checkout with changes is refused; where a step fails, it stays as it was.
Nothing is published: the last line says how.
"""

from __future__ import annotations

import argparse
import datetime
import hashlib
import re
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent

VERSIONS = {
    "pyproject.toml": r'^(version = ")[^"]+(")$',
    "blender_manifest.toml": r'^(version = ")[^"]+(")$',
    "solver/version.py": r'^(VERSION = ")[^"]+(")$',
    "CITATION.cff": r"^(version: )\S+()$",
}
"""Files that hold the version, and where: the same in all."""

NEWEST = re.compile(r"^## (\d+\.\d+\.\d+) - (\S+)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
UNRELEASED = "unreleased"


class ReleaseError(Exception):
    """A release cannot be made, and why."""


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("version", help="such as 0.2.0; CHANGELOG.md must begin with it, as unreleased")
    version = parser.parse_args(arguments).version
    folder = CHECKOUT / "dist" / f"release-{version}"
    try:
        check(version)
        set_version(version, datetime.date.today().isoformat())
        try:
            build(folder)
            (folder / "NOTES.md").write_text(notes(), encoding="utf-8")
            write_checksums(folder)
            git("commit", "--quiet", "--all", f"--message=Release {version}")
            git("tag", "--annotate", f"v{version}", f"--message=Sparse Surface {version}")
        except BaseException:
            git("checkout", "--quiet", "HEAD", "--", *VERSIONS, "CHANGELOG.md")
            raise
    except (ReleaseError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    print(f"{folder.relative_to(CHECKOUT)} is complete; publish it with: git push --follow-tags")
    return 0


def check(version: str) -> None:
    """Refuse what would make a wrong release, before anything is changed."""
    if not re.fullmatch(r"\d+\.\d+\.\d+", version):
        raise ReleaseError(f"'{version}' is not a version: write three numbers, such as 0.2.0.")
    changes = git("status", "--porcelain")
    if changes:
        raise ReleaseError(f"The checkout has changes; commit or remove them first:\n{changes}")
    if git("tag", "--list", f"v{version}"):
        raise ReleaseError(f"{version} was released already: there is the tag v{version}.")
    newest = NEWEST.search(read("CHANGELOG.md"))
    if newest is None or newest[1] != version or newest[2] != UNRELEASED:
        raise ReleaseError(f"CHANGELOG.md must begin with '## {version} - {UNRELEASED}'.")
    if not newest[3].strip():
        raise ReleaseError(f"CHANGELOG.md says nothing about {version}.")


def set_version(version: str, date: str) -> None:
    """Write the version into every file that holds it, and the date into the changelog."""
    for name, pattern in VERSIONS.items():
        text, count = re.subn(pattern, rf"\g<1>{version}\g<2>", read(name), flags=re.MULTILINE)
        if count != 1:
            raise ReleaseError(f"{name} has {count} versions instead of one.")
        write(name, text)
    write("CHANGELOG.md", read("CHANGELOG.md").replace(f"## {version} - {UNRELEASED}", f"## {version} - {date}", 1))


def build(folder: Path) -> None:
    """Build sdist and wheel, the extension's zips, and the documents."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    # The library's wheel has the kernel of this platform; on others pip builds it from the sdist, where a compiler is.
    run(sys.executable, "-m", "build", "--no-isolation", f"--outdir={folder}")
    run("make", "build", f"OUTPUT={folder}")
    run("make", "docs")
    shutil.make_archive(str(folder / "docs"), "zip", CHECKOUT / "dist" / "docs")


def notes() -> str:
    """Return what the changelog says of the newest version."""
    newest = NEWEST.search(read("CHANGELOG.md"))
    assert newest is not None, "checked before"
    return newest[3].strip() + "\n"


def write_checksums(folder: Path) -> None:
    """Write SHA256SUMS, as `sha256sum --check` reads it."""
    files = sorted(path for path in folder.iterdir() if path.name != "SHA256SUMS")
    lines = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in files]
    (folder / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


def read(name: str) -> str:
    return (CHECKOUT / name).read_text(encoding="utf-8")


def write(name: str, text: str) -> None:
    (CHECKOUT / name).write_text(text, encoding="utf-8")


def git(*words: str) -> str:
    done = subprocess.run(["git", *words], cwd=CHECKOUT, capture_output=True, text=True)
    if done.returncode != 0:
        raise ReleaseError(f"git {words[0]} failed: {done.stderr.strip()}")
    return done.stdout.strip()


def run(*command: str) -> None:
    if subprocess.run(command, cwd=CHECKOUT).returncode != 0:
        raise ReleaseError(f"`{' '.join(command)}` failed; nothing was released.")


if __name__ == "__main__":
    sys.exit(main())

"""Nothing tracked belongs to one machine only, is a product, or says that work is left undone."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent


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

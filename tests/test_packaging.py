"""The versions, lists and texts that packaging repeats agree with each other."""

from __future__ import annotations

import ast
import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

CHECKOUT = Path(__file__).resolve().parent.parent
LAYERS = ("operators", "solver", "ui")


def toml(name: str) -> dict[str, Any]:
    return tomllib.loads((CHECKOUT / name).read_text(encoding="utf-8"))


def requirements(name: str) -> dict[str, Requirement]:
    lines = (CHECKOUT / "requirements" / name).read_text(encoding="utf-8").replace("\\\n", " ").splitlines()
    found = [Requirement(line.split(" --hash")[0]) for line in lines if line.strip() and not line.startswith("#")]
    return {requirement.name: requirement for requirement in found}


def pin(requirement: Requirement) -> Version:
    (specifier,) = requirement.specifier
    assert specifier.operator == "=="
    return Version(specifier.version)


def literal(path: Path, name: str) -> str | None:
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id == name:
            return str(ast.literal_eval(node.value))
    return None


def test_one_version() -> None:
    version = toml("blender_manifest.toml")["version"]
    assert re.fullmatch(r"\d+\.\d+\.\d+", version)
    assert toml("pyproject.toml")["project"]["version"] == version
    citation = (CHECKOUT / "CITATION.cff").read_text(encoding="utf-8")
    assert re.search(r"^version: (\S+)$", citation, re.MULTILINE)[1] == version  # type: ignore[index]
    changes = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\d+\.\d+\.\d+)", changes, re.MULTILINE)[1] == version  # type: ignore[index]
    in_code = {literal(path, "__version__") for path in [*CHECKOUT.glob("*.py"), *(CHECKOUT / "solver").glob("*.py")]}
    in_code |= {literal(path, "VERSION") for path in (CHECKOUT / "solver").glob("*.py")}
    assert {found for found in in_code if found is not None} == {version}


def test_every_folder_with_code_is_a_listed_package() -> None:
    folders = {path.parent for layer in LAYERS for path in (CHECKOUT / layer).rglob("*.py")}
    for folder in folders:
        assert (folder / "__init__.py").exists(), folder
    names = {".".join(["sparse_surface", *folder.relative_to(CHECKOUT).parts]) for folder in folders}
    assert set(toml("pyproject.toml")["tool"]["setuptools"]["packages"]) == names | {"sparse_surface"}


def test_manifest_keeps_blenders_rules() -> None:
    manifest = toml("blender_manifest.toml")
    for text in (manifest["tagline"], *manifest["permissions"].values()):
        assert len(text) <= 64
        assert text[-1].isalnum()
    assert "blender" not in manifest["name"].lower()
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert "wheels" not in manifest, "the wheels of a zip are written by `make build`"


def test_licence_is_the_full_text() -> None:
    text = (CHECKOUT / "LICENSE").read_text(encoding="utf-8")
    assert "GNU GENERAL PUBLIC LICENSE" in text
    assert "Version 3, 29 June 2007" in text
    assert "END OF TERMS AND CONDITIONS" in text


@pytest.mark.parametrize("path", sorted((CHECKOUT / "requirements").glob("*.txt")), ids=lambda path: path.stem)
def test_everything_is_pinned(path: Path) -> None:
    for requirement in requirements(path.name).values():
        pin(requirement)


def test_wheels_of_the_zips() -> None:
    """Blender 4.2.0 takes the newest wheel whatever Python it is for: that must be the one for its own, 3.11."""
    older, newer = requirements("extension-cp313.txt"), requirements("extension-cp311.txt")
    assert set(older) == set(newer) == {"scipy", "scikit-learn", "joblib", "threadpoolctl"}
    for name in ("scipy", "scikit-learn"):
        assert pin(older[name]) < pin(newer[name])
    for name in ("joblib", "threadpoolctl"):
        assert pin(older[name]) == pin(newer[name])
    tested = requirements("solver.txt")
    assert {name: pin(tested[name]) for name in tested} == {name: pin(newer[name]) for name in newer}


def test_every_wheel_has_its_hashes() -> None:
    for name in ("extension-cp311.txt", "extension-cp313.txt"):
        text = (CHECKOUT / "requirements" / name).read_text(encoding="utf-8")
        hashes = re.findall(r"--hash=sha256:([0-9a-f]{64})\b", text)
        assert len(hashes) == len(set(hashes)) >= len(requirements(name))


def test_dependencies_admit_the_pins() -> None:
    project = {
        requirement.name: requirement
        for requirement in map(Requirement, toml("pyproject.toml")["project"]["dependencies"])
    }
    assert pin(requirements("solver.txt")["scipy"]) in project["scipy"].specifier
    assert pin(requirements("solver.txt")["scikit-learn"]) in project["scikit-learn"].specifier
    for path in (CHECKOUT / "requirements").glob("blender-*.txt"):
        assert pin(requirements(path.name)["numpy"]) in project["numpy"].specifier


def test_supported_blenders() -> None:
    files = {
        path.stem.removeprefix("blender-"): requirements(path.name)
        for path in (CHECKOUT / "requirements").glob("blender-*")
    }
    assert set(files) == {"4.2", "4.5", "5.0", "5.1", "5.2"}
    for version, pinned in files.items():
        assert str(pin(pinned["bpy"])).startswith(version + ".")
        assert str(pinned["bpy"].marker) in ('python_version == "3.11"', 'python_version == "3.13"')

"""The versions, lists and texts that packaging repeats agree with each other."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.version import Version

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = tuple(
    name
    for name in ("benchmarks", "command_line", "operators", "solver", "ui")
    if (CHECKOUT / name / "__init__.py").exists()
)


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


def script(name: str) -> ModuleType:
    """Import a development script, as it imports its neighbours."""
    sys.path.insert(0, str(CHECKOUT / "scripts"))
    try:
        return importlib.import_module(name)
    finally:
        sys.path.pop(0)


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
    folders = {path.parent for layer in PACKAGES for path in (CHECKOUT / layer).rglob("*.py")}
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


def test_documents_name_targets_that_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    for path in [CHECKOUT / "README.md", CHECKOUT / "CONTRIBUTING.md", *(CHECKOUT / "docs").glob("*.md")]:
        named = set(
            re.findall(r"`?\bmake ([a-z]+(?:-[a-z]+)*)(?=[`\s]*$|`| [A-Z]+=)", path.read_text(encoding="utf-8"), re.M)
        )
        assert named <= targets, (path.name, named - targets)


def test_zip_is_the_same_whenever_it_is_built(tmp_path: Path) -> None:
    building = script("build_extension")
    first = building.build("nowheels", tmp_path / "first").read_bytes()
    os.utime(CHECKOUT / "solver" / "settings.py")
    second = building.build("nowheels", tmp_path / "second")
    assert second.read_bytes() == first
    with zipfile.ZipFile(second) as file:
        assert {entry.date_time[:3] for entry in file.infolist()} == {(1980, 1, 1)}
        assert "wheels" not in tomllib.loads(file.read("blender_manifest.toml").decode())
        kernels = {name for name in file.namelist() if "/built/" in name}
    targets = script("build_native").TARGETS
    assert kernels == {f"solver/native/built/{name}/libkernel.{each.extension}" for name, each in targets.items()}


def test_a_package_for_several_platforms_has_the_kernel_of_this_one(tmp_path: Path) -> None:
    """A Blender that brings its own SciPy fits as fast as one with our wheels."""
    package = tmp_path / "sparse_surface"
    with zipfile.ZipFile(script("build_extension").build("nowheels", tmp_path)) as file:
        file.extractall(package)
    code = "from sparse_surface.solver.native import library; print(library.path(), library.reason_against())"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, check=True, capture_output=True, text=True)
    path, _, reason = done.stdout.strip().partition(" ")
    assert Path(path).is_relative_to(package)
    assert reason == "None"


@pytest.mark.parametrize("platform", ["linux-x64", "windows-x64", "macos-arm64", "macos-x64"])
def test_manifest_of_a_zip_names_its_platform_and_wheels(platform: str) -> None:
    text = script("build_extension").manifest_text(platform, ["a.whl", "b.whl"])
    manifest = tomllib.loads(text)
    assert manifest["platforms"] == [platform]
    assert manifest["wheels"] == ["./wheels/a.whl", "./wheels/b.whl"]
    assert {key: manifest[key] for key in toml("blender_manifest.toml")} == toml("blender_manifest.toml")


@pytest.mark.parametrize(("python", "first", "end"), [("cp311", "4.2.0", "5.1.0"), ("cp313", "5.1.0", None)])
def test_zip_of_one_generation_says_for_which_blenders(python: str, first: str, end: str | None) -> None:
    building = script("build_extension")
    manifest = tomllib.loads(building.manifest_text("linux-x64", ["a.whl"], python))
    assert (manifest["blender_version_min"], manifest.get("blender_version_max")) == (first, end)
    assert manifest["platforms"] == ["linux-x64"]
    assert building.parts_of(f"linux-x64-{python}") == ("linux-x64", python)


def test_every_platform_has_a_zip_for_each_of_its_pythons() -> None:
    building = script("build_extension")
    kinds = building.kinds_by_default()
    assert kinds == [
        *("linux-x64-cp311", "linux-x64-cp313", "windows-x64-cp311", "windows-x64-cp313"),
        *("macos-arm64-cp311", "macos-arm64-cp313", "macos-x64-cp311", "nowheels"),
    ]
    assert len({building.zip_name(kind) for kind in kinds}) == len(kinds)
    assert building.zip_name("linux-x64-cp313").endswith("-linux_x64-blender_5.1.zip")


def test_wheel_with_another_hash_is_not_taken(tmp_path: Path) -> None:
    wheels = script("extension_wheels")
    for name, version in wheels.pins("cp311").items():
        (tmp_path / f"{name.replace('-', '_')}-{version}-py3-none-any.whl").write_bytes(b"not the pinned one")
    assert wheels.wheels_in(tmp_path, "cp311") == []


def test_wrong_manifest_is_refused_with_the_builders_words(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    building = script("build_extension")
    source = building.manifest_source().replace(
        "Smooth surface patches that", "Smooth surface patches, in a tagline too long, that"
    )
    monkeypatch.setattr(building, "manifest_source", lambda: source)
    with pytest.raises(building.BuildError, match="tagline"):
        building.build("nowheels", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_find_python_skips_what_does_not_run(tmp_path: Path) -> None:
    """A shim that exists but fails must not be taken for a Python."""
    wanted = f"{sys.version_info.major}.{sys.version_info.minor}"
    shim = tmp_path / f"python{wanted}"
    shim.write_text("#!/bin/sh\necho no such version >&2\nexit 127\n")
    shim.chmod(0o755)
    environ = {**os.environ, "PATH": f"{tmp_path}:{Path(sys.executable).parent}:{os.environ['PATH']}", "PYTHON": ""}
    find = [str(CHECKOUT / "scripts" / "find_python.sh"), wanted]
    found = subprocess.run(find, capture_output=True, text=True, env=environ, check=True).stdout.strip()
    assert Path(found).parent != tmp_path
    assert subprocess.run([found, "-c", "import sys"]).returncode == 0
    missing = subprocess.run([find[0], "2.99"], capture_output=True, text=True, env=environ)
    assert missing.returncode == 1
    assert missing.stdout == ""
    assert len(missing.stderr.splitlines()) == 1


@pytest.mark.parametrize("tool", ["absent", "broken"])
def test_ci_does_not_fail_where_no_window_can_be_had(
    tool: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It says so in one line for each Blender; asking for the window tests is a failure."""
    window = script("test_window")
    path = tmp_path / "real-blender"
    if tool == "broken":
        path.write_text("#!/bin/sh\necho no mirror >&2\nexit 2\n")
        path.chmod(0o755)
    monkeypatch.delenv("BLENDER", raising=False)
    monkeypatch.setattr(window, "TOOL", path)
    assert window.main(["--where-available"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == (1 if tool == "absent" else 2)
    assert all(line.startswith("Window tests were not run: ") for line in lines)
    assert tool == "absent" or all("no mirror" in line for line in lines)
    assert window.main([]) == 1


def test_what_tests_need_can_be_fetched_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Blenders and environments are set up, nothing is tested, and what cannot be had is said."""
    window, tool, calls = script("test_window"), tmp_path / "real-blender", tmp_path / "calls"
    tool.write_text(f'#!/bin/sh\necho "$1 $2" >> {calls}\n[ "$1" != 4.3 ] || {{ echo no mirror >&2; exit 2; }}\n')
    tool.chmod(0o755)
    monkeypatch.delenv("BLENDER", raising=False)
    monkeypatch.setattr(window, "TOOL", tool)
    assert window.main(["--prepare"]) == 0
    assert calls.read_text().splitlines() == ["5.2 setup", "4.3 setup"]
    assert capsys.readouterr().err == "blender-4.3: no mirror\n"
    matrix, made = script("test_matrix"), []

    def environment(name: str, row: object) -> Path:
        made.append(name)
        raise LookupError("Python 2.99 not found")

    monkeypatch.setitem(matrix.main.__globals__, "environment", environment)
    monkeypatch.setitem(matrix.main.__globals__, "LOGS", tmp_path / "logs")
    assert matrix.main(["4.2", "5.2", "--prepare"]) == 0
    assert made == ["4.2", "5.2"]
    assert capsys.readouterr().err == "4.2: Python 2.99 not found\n5.2: Python 2.99 not found\n"


def window_tests(folder: Path, monkeypatch: pytest.MonkeyPatch, *, scripts_end_with: int, say: str = "passed x") -> Any:
    """Return the script that runs the window tests, with a Blender that ends each of them in this way."""
    window = script("test_window")
    tool = folder / "real-blender"
    tool.write_text(f'#!/bin/sh\n[ "$2" != gui ] || {{ echo "{say}"; exit {scripts_end_with}; }}\n')
    tool.chmod(0o755)
    monkeypatch.delenv("BLENDER", raising=False)
    monkeypatch.setattr(window, "TOOL", tool)
    monkeypatch.setattr(window, "OUT", folder / "out")
    monkeypatch.setattr(window, "build", lambda kind, folder: folder / "extension.zip")
    return window


def test_a_failing_window_test_fails_ci(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    window = window_tests(tmp_path, monkeypatch, scripts_end_with=1)
    assert window.main(["--where-available", "test_quit"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "0 passed, 2 failed"


def test_a_window_script_without_tests_fails_ci(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    window = window_tests(tmp_path, monkeypatch, scripts_end_with=0, say="Blender quit")
    assert window.main(["test_quit"]) == 1
    assert "No test was run." in capsys.readouterr().out


def test_window_scripts_can_be_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    window = window_tests(tmp_path, monkeypatch, scripts_end_with=0)
    every = sorted(path.stem for path in window.SCRIPTS.glob("test_*.py"))
    assert window.main(["--but", "test_responsiveness"]) == 0
    lines = capsys.readouterr().out.splitlines()
    run = [name for name in every if any(name in line for line in lines)]
    assert run == [name for name in every if name != "test_responsiveness"]
    assert lines[-1] == f"{2 * len(run)} passed, 0 failed"


def test_window_scripts_for_which_there_is_no_time_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    window = window_tests(tmp_path, monkeypatch, scripts_end_with=1)
    assert window.main(["test_quit", "test_job", "--begin-within", "-1"]) == 0
    said = capsys.readouterr()
    names = [f"blender-{version}  {name}" for version in window.TOOL_VERSIONS for name in ("test_quit", "test_job")]
    assert said.out.splitlines() == [f"{name}: left out, for lack of time" for name in names]
    assert said.err == ""
    assert window.main(["test_quit", "--begin-within", "600"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "0 passed, 2 failed"


def test_wheel_of_the_library_holds_the_package_and_nothing_else(tmp_path: Path) -> None:
    source, files = tmp_path / "source", script("build_extension").package_files()
    needed = [*(CHECKOUT / "solver" / "native").glob("*.[ch]"), *(CHECKOUT / "scripts").glob("build_*.py")]
    # Measuring is for those who work on the library; the extension goes without.
    files = sorted({*files, *(path.relative_to(CHECKOUT) for path in (CHECKOUT / "benchmarks").rglob("*.py"))})
    other = [Path("pyproject.toml"), Path("README.md"), Path("blender_manifest.toml")]
    for path in [*files, *other, *(path.relative_to(CHECKOUT) for path in needed)]:
        (source / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CHECKOUT / path, source / path)
    built = script("build_native").library_here().relative_to(CHECKOUT)
    if (CHECKOUT / built).exists():  # newer than its sources: it is not compiled again
        (source / built).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(CHECKOUT / built, source / built)
    (source / "tests").mkdir()
    (source / "tests" / "test_x.py").write_text("")
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, f"--wheel-dir={tmp_path}", str(source)], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        names = {name.removeprefix("sparse_surface/") for name in file.namelist() if name.startswith("sparse_surface/")}
        assert {name.partition("/")[0] for name in file.namelist()} == {
            "sparse_surface",
            f"sparse_surface-{toml('pyproject.toml')['project']['version']}.dist-info",
        }
    kernel = {name for name in names if name.startswith("solver/native/built/")}
    only_in_zips = {"CHANGELOG.md", "LICENSE"}  # a wheel has the licence beside its metadata
    wanted = {path.as_posix() for path in files} - only_in_zips | {"blender_manifest.toml"}
    assert names - kernel == wanted
    # With a C compiler the wheel holds the kernel of this platform, and says so.
    assert len(kernel) == (script("build_native").compiler_of_this_machine() is not None)
    assert wheel.name.endswith("-py3-none-any.whl") == (not kernel)


def test_the_sdist_holds_what_builds_the_wheel(tmp_path: Path) -> None:
    source = tmp_path / "source"
    tracked = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, check=True, capture_output=True, text=True).stdout
    for name in filter(None, tracked.split("\0")):
        if (CHECKOUT / name).is_file() and not name.startswith(("tests/", "docs/")):
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(CHECKOUT / name, source / name)
    build = "import sys; from setuptools import build_meta; print(build_meta.build_sdist(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", build, str(tmp_path)], cwd=source, check=True, capture_output=True)
    assert done.stdout
    (sdist,) = tmp_path.glob("*.tar.gz")
    shutil.unpack_archive(sdist, tmp_path / "unpacked", filter="data")
    (unpacked,) = (tmp_path / "unpacked").iterdir()
    assert not list(unpacked.glob("solver/native/built/*"))
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, f"--wheel-dir={tmp_path}", str(unpacked)], check=True, capture_output=True)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as file:
        kernel = [name for name in file.namelist() if "solver/native/built/" in name]
    assert len(kernel) == (script("build_native").compiler_of_this_machine() is not None)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads ELF files")
def test_the_kernel_is_small_and_needs_only_the_c_library() -> None:
    native = script("build_native")
    readelf, library = shutil.which("readelf"), native.build_here()
    if readelf is None or library is None:
        pytest.skip("there is no compiler or no readelf")
    assert library.stat().st_size <= 512 * 1024
    command = [readelf, "--wide", "--dynamic", "--dyn-syms", str(library)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert set(re.findall(r"NEEDED.*\[(\w+)", said)) <= {"libc", "libm"}
    own = set(re.findall(r"GLOBAL\s+DEFAULT\s+\d+ (\w+)", said))
    assert {"instruction_set", "fit_problems_baseline"} <= own


def test_without_a_compiler_the_kernel_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    native = script("build_native")
    monkeypatch.setattr(native, "library_here", lambda: tmp_path / "libkernel.so")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert native.main([]) == 0
    assert "NumPy fits the patches" in capsys.readouterr().out
    assert native.main(["--if-needed"]) == 0
    assert capsys.readouterr().out == ""


def test_a_failing_compiler_is_quoted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    native = script("build_native")
    compiler = tmp_path / "cc"
    compiler.write_text("#!/bin/sh\necho no such machine >&2\nexit 1\n")
    compiler.chmod(0o755)
    monkeypatch.setattr(native, "library_here", lambda: tmp_path / "built" / "libkernel.so")
    monkeypatch.setenv("CC", str(compiler))
    with pytest.raises(native.NativeBuildError, match="no such machine"):
        native.build_here()
    assert not (tmp_path / "built" / "libkernel.so").exists()

"""A release: what is refused, what is written, and that a failure leaves the checkout as it was."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from pathlib import Path
from types import ModuleType

import pytest

CHECKOUT = Path(__file__).resolve().parent.parent
LOG = "# Changelog\n\n## 9.8.7 - unreleased\n\n- Something new.\n\n## 0.1.0 - 2020-01-01\n\n- First.\n"


def git(folder: Path, *words: str) -> str:
    own = ["-c", "user.name=a", "-c", "user.email=a@b.c"]
    return subprocess.run(["git", *own, *words], cwd=folder, check=True, capture_output=True, text=True).stdout


@pytest.fixture
def release(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """Return the script over a repository of its own, with a build that makes two files."""
    monkeypatch.syspath_prepend(str(CHECKOUT / "scripts"))
    module = importlib.import_module("release")
    for name in module.VERSIONS:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        shutil.copyfile(CHECKOUT / name, tmp_path / name)
    (tmp_path / "CHANGELOG.md").write_text(LOG)
    (tmp_path / ".gitignore").write_text("dist/\n")
    git(tmp_path, "init", "--quiet")
    git(tmp_path, "config", "user.name", "a")
    git(tmp_path, "config", "user.email", "a@b.c")
    git(tmp_path, "add", "--all")
    git(tmp_path, "commit", "--quiet", "--message=first")

    def build(folder: Path) -> None:
        folder.mkdir(parents=True)
        for name in ("b.whl", "a.zip"):
            (folder / name).write_bytes(name.encode())

    monkeypatch.setattr(module, "CHECKOUT", tmp_path)
    monkeypatch.setattr(module, "build", build)
    return module


def test_a_release_has_one_version_notes_and_checksums(release: ModuleType, tmp_path: Path) -> None:
    assert release.main(["9.8.7"]) == 0
    folder = tmp_path / "dist" / "release-9.8.7"
    assert sorted(path.name for path in folder.iterdir()) == ["NOTES.md", "SHA256SUMS", "a.zip", "b.whl"]
    assert (folder / "NOTES.md").read_text() == "- Something new.\n"
    subprocess.run(["sha256sum", "--check", "--strict", "SHA256SUMS"], cwd=folder, check=True, capture_output=True)
    for name in release.VERSIONS:
        assert "9.8.7" in (tmp_path / name).read_text()
    assert "unreleased" not in (tmp_path / "CHANGELOG.md").read_text()
    assert git(tmp_path, "status", "--porcelain") == ""
    assert git(tmp_path, "describe").strip() == "v9.8.7"


@pytest.mark.parametrize(
    ("version", "change", "said"),
    [
        ("9.8", "", "is not a version"),
        ("9.8.7", "new.txt", "has changes"),
        ("9.8.6", "", "must begin with '## 9.8.6 - unreleased'"),
        ("0.1.0", "", "must begin with"),
        ("9.8.7", "tag", "released already"),
    ],
)
def test_refusals(
    release: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str], version: str, change: str, said: str
) -> None:
    if change == "tag":
        git(tmp_path, "tag", "v9.8.7")
    elif change:
        (tmp_path / change).write_text("x")
    before = {name: (tmp_path / name).read_bytes() for name in release.VERSIONS}
    assert release.main([version]) == 1
    assert said in capsys.readouterr().err
    assert {name: (tmp_path / name).read_bytes() for name in release.VERSIONS} == before
    assert not (tmp_path / "dist").exists()


def test_a_failed_step_leaves_the_checkout_as_it_was(
    release: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(folder: Path) -> None:
        release.run("false")

    monkeypatch.setattr(release, "build", fail)
    assert release.main(["9.8.7"]) == 1
    assert "`false` failed" in capsys.readouterr().err
    assert git(tmp_path, "status", "--porcelain") == git(tmp_path, "tag") == ""

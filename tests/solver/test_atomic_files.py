"""Files that appear when they are complete, and what stands beside them."""

from __future__ import annotations

from pathlib import Path

import pytest
from sparse_surface.solver.atomic_files import atomic_output, note_drafts, remove_drafts, scratch_folder


def write(path: Path, beside: dict[str, str]) -> None:
    with atomic_output(path) as draft:
        draft.write_text("mesh")
        for name, text in beside.items():
            (draft.parent / name).parent.mkdir(exist_ok=True)
            (draft.parent / name).write_text(text)


def test_folders_beside_a_file_are_filled_again_and_again(tmp_path: Path) -> None:
    for _ in range(2):
        write(tmp_path / "out.usdc", {"textures/wood.png": "wood", "out.bin": "own"})
    assert (tmp_path / "textures" / "wood.png").read_text() == "wood"
    write(tmp_path / "out.usdc", {"out.bin": "changed"})
    assert (tmp_path / "out.bin").read_text() == "changed"


def test_a_texture_of_another_file_stays(tmp_path: Path) -> None:
    (tmp_path / "wood.png").write_text("of another file")
    (tmp_path / "out.gltf").write_text("older")
    with pytest.raises(OSError, match="another file already"):
        write(tmp_path / "out.gltf", {"wood.png": "wood"})
    assert (tmp_path / "wood.png").read_text() == "of another file"
    assert (tmp_path / "out.gltf").read_text() == "older"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.gltf", "wood.png"]


def test_noted_drafts_can_be_removed_by_another(tmp_path: Path) -> None:
    folder = scratch_folder()
    note_drafts(folder)
    try:
        waiting = atomic_output(tmp_path / "out.txt")
        draft = waiting.__enter__()
        draft.write_text("half")
        remove_drafts(folder)
        assert list(tmp_path.iterdir()) == []
        assert not folder.exists()
    finally:
        note_drafts(tmp_path / "nowhere")
        import sparse_surface.solver.atomic_files as module

        module._noted_in.clear()


def test_a_draft_beside_its_place_appears_and_goes_like_others(tmp_path: Path) -> None:
    with atomic_output(tmp_path / "out.blend", beside=True) as draft:
        assert draft.parent == tmp_path
        assert draft.name != "out.blend"
        draft.write_text("scene")
    assert (tmp_path / "out.blend").read_text() == "scene"
    with pytest.raises(ValueError, match="no"):
        fail_beside(tmp_path / "out.blend")
    assert (tmp_path / "out.blend").read_text() == "scene"
    assert [path.name for path in tmp_path.iterdir()] == ["out.blend"]
    with pytest.raises(OSError, match="was not written"), atomic_output(tmp_path / "none.blend", beside=True):
        pass


def fail_beside(path: Path) -> None:
    with atomic_output(path, beside=True) as draft:
        draft.write_text("half")
        draft.with_name(draft.name + "@").write_text("of the writer's own")
        raise ValueError("no")

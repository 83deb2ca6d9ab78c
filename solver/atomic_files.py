"""Files that appear when they are complete."""

from __future__ import annotations

import contextlib
import filecmp
import glob
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOM = 1 << 16
"""Bytes that must still fit on the disk after a silent writer has finished."""

LONGEST_STEM = 40
"""Characters of a file's name that its draft's folder has: a name may be as long as the system allows."""

_noted_in: list[Path] = []


def scratch_folder() -> Path:
    """Make a temporary folder for a process, in which it notes the drafts that it leaves if it is killed."""
    return Path(tempfile.mkdtemp(prefix="sparse_surface_"))


def note_drafts(folder: Path) -> None:
    """Note every draft of this process in a folder from now on, for `remove_drafts`."""
    _noted_in[:] = [folder]


def remove_drafts(folder: Path) -> None:
    """Remove the drafts that a process has noted in a folder, and the folder."""
    for note in folder.glob("*.draft"):
        with contextlib.suppress(OSError):
            _remove(Path(note.read_text(encoding="utf-8")))
    shutil.rmtree(folder, ignore_errors=True)


@contextlib.contextmanager
def atomic_output(path: Path, *, silent_writer: bool = False, beside: bool = False) -> Iterator[Path]:
    """Yield a path to write to; when the block ends well, the file moves to `path`, and when it fails nothing remains.

    The draft has the same file name in a temporary folder beside `path`, because exporters write further files
    (materials, buffers) that refer to each other by name.  A file that is replaced keeps its permissions, a symbolic
    link what it leads to; a pipe, or anything else that is not a regular file, gets the content.

    Parameters
    ----------
    silent_writer
        Whether what writes may cut a file short on a full disk without an error, as Blender's exporters do.
    beside
        Whether the draft itself, under another name, is to lie in the folder of `path`: in a file that names others
        by where they are from it.

    Raises
    ------
    OSError
        When the folder cannot be written, nothing was written, or the disk is full.
    """
    goal = Path(os.path.realpath(path))
    special = goal.exists() and not goal.is_file()
    with _draft_folder(Path(tempfile.gettempdir()) if special else goal.parent, path.stem) as folder:
        yield folder.with_name(folder.name + path.suffix) if beside else folder / path.name
        if beside and (draft := folder.with_name(folder.name + path.suffix)).is_file():
            draft.replace(folder / path.name)
        if not (folder / path.name).is_file():
            raise OSError(f"'{path}' was not written")
        if silent_writer:
            _check_room(folder)
        places = _places(folder, path, goal)
        for product, place in places.items():
            if special and place == goal:
                with open(product, "rb") as content, open(goal, "wb") as pipe:
                    shutil.copyfileobj(content, pipe)
            else:
                _replace(product, place)


def _places(folder: Path, path: Path, goal: Path) -> dict[Path, Path]:
    """Return where each file of a draft goes: what stands beside the output, textures for example, keeps its place.

    Raises
    ------
    OSError
        When one of them would replace a file that has nothing to do with this output.
    """
    places = {}
    for product in sorted(each for each in folder.rglob("*") if each.is_file()):
        place = goal if product == folder / path.name else path.absolute().parent / product.relative_to(folder)
        own = product.name.startswith(path.stem)
        if not own and place.exists() and not filecmp.cmp(product, place, shallow=False):
            raise OSError(f"'{place}' is another file already, and '{path.name}' would replace it")
        places[product] = place
    return places


@contextlib.contextmanager
def _draft_folder(beside: Path, stem: str) -> Iterator[Path]:
    """Make a folder, noted before it is there, and remove it with what it holds."""
    token = secrets.token_hex(4)
    folder = beside / f".{stem[:LONGEST_STEM]}_{token}"
    notes = [place / f"{token}.draft" for place in _noted_in]
    for note in notes:
        note.write_text(str(folder), encoding="utf-8")
    try:
        folder.mkdir(mode=0o700)
        yield folder
    finally:
        _remove(folder)
        for note in notes:
            note.unlink(missing_ok=True)


def _remove(folder: Path) -> None:
    """Remove the folder of a draft, and the files beside it whose names begin with its own."""
    shutil.rmtree(folder, ignore_errors=True)
    for file in folder.parent.glob(f"{glob.escape(folder.name)}.*"):
        with contextlib.suppress(OSError):
            file.unlink()


def _replace(product: Path, place: Path) -> None:
    """Move a file to its place, where it gets the permissions of the one that was there."""
    place.parent.mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(OSError):
        os.chmod(product, stat.S_IMODE(os.stat(place).st_mode))
    os.replace(product, place)


def _check_room(folder: Path) -> None:
    """Raise what writing to a full disk raises, even if the writer did not notice that its file is too short."""
    with open(folder / "room", "wb") as file:
        file.write(bytes(ROOM))
        file.flush()
        os.fsync(file.fileno())
    os.unlink(folder / "room")

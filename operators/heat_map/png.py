"""Renders a scene to a PNG file whose bytes depend on the picture only."""

from __future__ import annotations

import os
import struct
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import bpy
import numpy as np
from bpy.types import Scene

from ...solver.atomic_files import atomic_output
from .raster import Shape, draw


def render_png(scene: Scene, picture: Path, over: Sequence[Shape] = ()) -> None:
    """Render to a file that appears when it is complete, with flat shapes drawn over what was rendered."""
    with atomic_output(picture, silent_writer=True) as draft:
        scene.render.filepath = str(draft)
        scene.render.use_file_extension = False
        with _quiet():
            bpy.ops.render.render(write_still=True, scene=scene.name)
        _draw_over(draft, over)
        draft.write_bytes(without_texts(draft.read_bytes()))


def _draw_over(file: Path, shapes: Sequence[Shape]) -> None:
    if not shapes:
        return
    image = bpy.data.images.load(str(file))
    width, height = image.size
    values = np.empty(width * height * 4, dtype=np.float32)
    image.pixels.foreach_get(values)
    draw(values.reshape(height, width, 4), shapes)
    image.pixels.foreach_set(values)
    image.save()
    bpy.data.images.remove(image)


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep the renderer's log, a line for each sample, off the terminal."""
    try:
        sys.stdout.flush()
        terminal = os.dup(1)
    except (OSError, AttributeError):  # a program without a terminal
        yield
        return
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.close(nowhere)
        yield
    finally:
        os.dup2(terminal, 1)
        os.close(terminal)


def without_texts(png: bytes) -> bytes:
    """Drop a PNG's text chunks: Cycles writes its run time there, and the same picture should be the same file."""
    kept, at = [png[:8]], 8
    while at < len(png):
        (length,) = struct.unpack(">I", png[at : at + 4])
        if png[at + 4 : at + 8] not in (b"tEXt", b"zTXt", b"iTXt", b"tIME", b"eXIf"):
            kept.append(png[at : at + 12 + length])
        at += 12 + length
    return b"".join(kept)

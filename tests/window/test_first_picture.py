"""From the click to the first picture of the surface: a second for small meshes, three for the bunny's size.

Measured as an artist meets it, with the compiled kernel, the sidebar open, and default settings: until the surface is
handed to the window, which may still be drawing a new object, and until it is painted in a window that rests.  The
solver gives way to every other program, so with `--shared-machine` the quickest of five clicks may take twice as long.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).parent))
import driver

CLICKS, FACTOR = (5, 2.0) if driver.SHARED_MACHINE else (1, 1.0)

BUNNY = 190
"""Vertices along a side of a sheet as large as the bunny, which has 35,947."""


def add_suzanne() -> Any:
    """Add and select Blender's own monkey, subdivided twice: 7,958 vertices."""
    with driver.in_viewport():
        bpy.ops.mesh.primitive_monkey_add()
        made = bpy.context.object
        made.modifiers.new("Subdivision", "SUBSURF").levels = 2
        bpy.ops.object.modifier_apply(modifier="Subdivision")
    assert len(made.data.vertices) == 7958
    return made


RESTS = 0.7
"""Seconds without a redraw after which the viewport is drawn: by software, each sample takes a third of a second."""


def drawn_viewport() -> driver.Steps:
    """Wait until Blender has drawn all samples of the viewport."""
    with driver.noted_drawings() as drawings:
        drawings.append(time.monotonic())
        yield from driver.wait_for(lambda: time.monotonic() - drawings[-1] > RESTS, 30.0, "drawn viewport")


def seconds_to_a_surface() -> driver.Steps:
    """Return the seconds from the press of the button until the window has something of the surface to draw."""
    clicked = time.monotonic()
    driver.approximate()
    yield from driver.wait_for(lambda: driver.drawn_objects() or driver.running() is None, 240.0, "picture or result")
    return time.monotonic() - clicked


def seconds_to_a_picture() -> driver.Steps:
    """Return the seconds from the press of the button until a viewport that rests shows something of the surface."""
    yield from drawn_viewport()
    with driver.noted_drawings(lambda: driver.drawn_objects() or len(bpy.data.objects) == 2) as pictures:
        clicked = time.monotonic()
        driver.approximate()
        yield from driver.wait_for(lambda: pictures, 240.0, "picture")
        return pictures[0] - clicked


def check_first_picture(add: Any, bound: float, measure: Callable[[], driver.Steps]) -> driver.Steps:
    """Hold the quickest of `CLICKS` to the bound."""
    taken = []
    for _ in range(CLICKS):
        driver.clear_scene()
        bpy.context.scene.sparse_surface.property_unset("solver")
        source = add()
        yield from driver.open_sidebar()
        yield 1.0
        taken.append((yield from measure()))
        driver.shot(f"first_picture_{source.name}")
        yield from driver.wait_for(lambda: driver.running() is None, 240.0, "result")
        yield 0.5
        assert len(bpy.data.objects) == 2
        if taken[-1] <= FACTOR * bound:
            break
    print(f"{measure.__name__}: {', '.join(f'{seconds:.2f}' for seconds in taken)}", flush=True)
    assert min(taken) <= FACTOR * bound, taken


def test_the_first_picture_of_suzanne_comes_within_a_second():
    for measure in (seconds_to_a_surface, seconds_to_a_picture):
        yield from check_first_picture(add_suzanne, 1.0, measure)


def test_the_first_picture_of_a_bunny_comes_within_three_seconds():
    for measure in (seconds_to_a_surface, seconds_to_a_picture):
        yield from check_first_picture(lambda: driver.add_creased_grid(BUNNY), 3.0, measure)


if __name__ == "__main__":
    driver.run(
        test_the_first_picture_of_suzanne_comes_within_a_second,
        test_the_first_picture_of_a_bunny_comes_within_three_seconds,
    )

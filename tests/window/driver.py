"""Drives the window that Blender has open: what the tests in this folder share.

Each ``test_*.py`` here is a script for one Blender with a window, in which the extension is enabled:
``blender --enable-event-simulate --python tests/window/test_x.py -- FOLDER [--shared-machine] [TEST ...]`` (the first
option only where it presses keys: see `scripts/test_window.py`).  Pictures of the window go into FOLDER.  Blender ends
with exit code 0 when the test has passed and 1 when it has failed.
"""

from __future__ import annotations

import importlib
import inspect
import os
import sys
import time
import traceback
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "blender"))
import scenes

select = scenes.select

Steps = Generator[float, None, None]
"""A test: between two of its `yield SECONDS` Blender draws and handles events."""

RESULT = "Creased Sparse Surface"
"""The result's name for the sheet that `start_job` adds."""

_ARGUMENTS = sys.argv[sys.argv.index("--") + 1 :]

FOLDER = Path(_ARGUMENTS[0])

SHARED_MACHINE = "--shared-machine" in _ARGUMENTS
"""Whether others' work may come between what is timed."""

_CHOSEN = [name for name in _ARGUMENTS[1:] if name != "--shared-machine"]


def run(*tests: Callable[..., Steps]) -> None:
    """Run tests, all or those that are named, one after the other; then quit Blender.  One that fails ends it at once.

    A test with a parameter `monkeypatch` is given a function: owner, name of an attribute, and its value in this test.
    """
    bpy.context.preferences.view.show_splash = False
    bpy.context.preferences.view.use_save_prompt = False
    bpy.context.preferences.use_preferences_save = False  # what a test changes is not for the next one
    steps = _chain(_named(tests))

    def step() -> float | None:
        try:
            return next(steps)
        except StopIteration:
            bpy.ops.wm.quit_blender()
        except BaseException:
            traceback.print_exc()
            with suppress(Exception):
                shot("failure")
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(1)
        return None

    bpy.app.timers.register(step, first_interval=1.0, persistent=True)
    if bpy.app.use_event_simulate:
        bpy.app.timers.register(_rest, persistent=True)


def _rest() -> float:
    """Let Blender sleep as it does for a user: told to take simulated keys, it would keep a core busy for itself."""
    time.sleep(0.004)
    return 0.0


def _named(tests: tuple[Callable[..., Steps], ...]) -> tuple[Callable[..., Steps], ...]:
    unknown = set(_CHOSEN) - {test.__name__ for test in tests}
    if unknown:
        print(f"There is no such test: {', '.join(sorted(unknown))}", flush=True)
        os._exit(1)
    return tuple(test for test in tests if not _CHOSEN or test.__name__ in _CHOSEN)


def _chain(tests: tuple[Callable[..., Steps], ...]) -> Iterator[float]:
    for test in tests:
        started = time.monotonic()
        with ExitStack() as stack:
            wanted = inspect.signature(test).parameters
            yield from test(**({"monkeypatch": partial(_patch, stack)} if "monkeypatch" in wanted else {}))
        print(f"passed {test.__name__} ({time.monotonic() - started:.1f} s)", flush=True)


def _patch(stack: ExitStack, owner: Any, name: str, value: Any) -> None:
    """Set an attribute until the test has ended."""
    stack.callback(setattr, owner, name, getattr(owner, name))
    setattr(owner, name, value)


def add_on() -> str:
    """Return the module name of the extension."""
    names = [name for name in bpy.context.preferences.addons.keys() if name.endswith(".sparse_surface")]  # noqa: SIM118
    assert len(names) == 1, names
    return names[0]


def module(name: str) -> ModuleType:
    """Import a module of the extension, such as "operators.run.control"."""
    return importlib.import_module(f"{add_on()}.{name}")


def window() -> Any:
    """Return the first window."""
    return bpy.context.window_manager.windows[0]


def viewport() -> Any:
    """Return the first 3D viewport's area."""
    return next(area for area in window().screen.areas if area.type == "VIEW_3D")


def region(kind: str) -> Any:
    """Return a region of the viewport: "WINDOW", "UI"."""
    return next(each for each in viewport().regions if each.type == kind)


def in_viewport() -> Any:
    """Return a context in which operators act as if called from the viewport."""
    return bpy.context.temp_override(window=window(), area=viewport(), region=region("WINDOW"))


def open_sidebar() -> Steps:
    """Show the sidebar with the extension's tab."""
    viewport().spaces.active.show_region_ui = True
    yield 0.3
    with suppress(TypeError):
        region("UI").active_panel_category = "Sparse Surface"
    viewport().tag_redraw()
    yield 0.3


def clear_scene() -> None:
    """Remove every object and mesh, and set every setting back, but fit with NumPy.

    With the compiled kernel small runs are over before anything can be done or seen beside them.
    """
    if bpy.context.mode != "OBJECT":
        with in_viewport():
            bpy.ops.object.mode_set(mode="OBJECT")
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.data.batch_remove(list(bpy.data.meshes))
    bpy.context.scene.property_unset("sparse_surface")
    settings = bpy.context.scene.sparse_surface
    for each in settings.bl_rna.properties:
        settings.property_unset(each.identifier)
    settings.solver = "numpy"


def add_creased_grid(size: int, name: str = "Creased", steps: float = 3.0) -> Any:
    """Add and select a square sheet of size x size vertices with sharp folds across its edges' directions."""
    made = scenes.creased_sheet(size, name, steps)
    with in_viewport():
        bpy.ops.ed.undo_push(message=f"Add {name}")
    return made


def press(key: str, *, at: Any = None, **modifiers: bool) -> None:
    """Press and release a key with the mouse over a region (default: the viewport)."""
    over = at or region("WINDOW")
    x, y = over.x + over.width // 2, over.y + over.height // 2
    window().event_simulate(type="MOUSEMOVE", value="NOTHING", x=x, y=y)
    for value in ("PRESS", "RELEASE"):
        window().event_simulate(type=key, value=value, x=x, y=y, **modifiers)


def click(x: int, y: int) -> None:
    """Click at a place of the window."""
    for kind, value in (("MOUSEMOVE", "NOTHING"), ("LEFTMOUSE", "PRESS"), ("LEFTMOUSE", "RELEASE")):
        window().event_simulate(type=kind, value=value, x=x, y=y)


def approximate() -> set[str]:
    """Press the button."""
    with in_viewport():
        return set(bpy.ops.sparse_surface.approximate("INVOKE_DEFAULT"))


def start_job(size: int = 60, **settings: Any) -> Generator[float, None, Any]:
    """Begin on a fresh sheet and wait until the solver says something."""
    clear_scene()
    for name, value in settings.items():
        setattr(bpy.context.scene.sparse_surface, name, value)
    sheet = add_creased_grid(size)
    yield 0.3
    assert approximate() == {"RUNNING_MODAL"}
    yield from wait_for(lambda: running().progress, 60.0, "first word of the solver")
    return sheet


def assert_nothing_left(objects: set[str]) -> Steps:
    """No run, no child process, no preview, no status text."""
    yield from wait_for(lambda: running() is None, 2.0, "end of the run")
    yield from wait_for(lambda: not children(), 2.0, "end of the child")
    yield 0.3
    assert {each.name for each in bpy.data.objects} == objects, [each.name for each in bpy.data.objects]
    assert len(bpy.data.meshes) == len(objects), [each.name for each in bpy.data.meshes]
    with in_viewport():
        assert bpy.ops.sparse_surface.approximate.poll() == bool(bpy.context.selected_objects)


def wait_for(condition: Callable[[], Any], seconds: float, what: str) -> Steps:
    """Let Blender run until the condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"{what}: not within {seconds} s"
        yield 0.02


def running() -> Any:
    """Return the current run of the extension, or None."""
    return module("operators.run.session").session.current


def drawn_objects() -> frozenset[int]:
    """Return the session numbers of the objects whose surfaces are drawn while they are being solved."""
    return frozenset(module("operators.preview.overlay")._drawn)


@contextmanager
def noted_drawings(shows: Callable[[], Any] = lambda: True) -> Iterator[list[float]]:
    """Note when Blender has drawn a viewport while it shows something, by `time.monotonic`."""
    drawings: list[float] = []

    def note() -> None:
        if shows():
            drawings.append(time.monotonic())

    handle = bpy.types.SpaceView3D.draw_handler_add(note, (), "WINDOW", "POST_PIXEL")
    try:
        yield drawings
    finally:
        bpy.types.SpaceView3D.draw_handler_remove(handle, "WINDOW")


def waiting_children() -> set[int]:
    """Return the process numbers of children that no run needs: they wait for the next, or make drafts compact."""
    jobs = sys.modules.get(f"{add_on()}.solver.job")
    prepared = list(jobs._prepared.values()) if jobs is not None else []
    crews = [executor._crew for executor in [*prepared, *module("operators.representation.compacting")._children]]
    return {worker._process.pid for crew in crews for worker in crew if worker._process is not None}


def children(*, waiting: bool = False) -> list[int]:
    """Return the process numbers of the solver's processes, workers of workers too (where there is /proc).

    Those that wait for the next run are among them only on request.
    """
    found = []
    spared = set() if waiting else waiting_children()
    for command in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            if b"child_main.py" in command.read_bytes() and int(command.parent.name) not in spared:
                found.append(int(command.parent.name))
    return found


def processor_seconds(child: int) -> float:
    """Return how long a process has worked (where there is /proc), 0 where it has ended."""
    with suppress(OSError):
        user, system = Path(f"/proc/{child}/stat").read_text().rpartition(")")[2].split()[11:13]
        return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
    return 0.0


def shot(name: str) -> None:
    """Take a picture of the window."""
    path = str(FOLDER / f"{name}.png")
    try:
        import real_blender
    except ImportError:
        with bpy.context.temp_override(window=window()):
            bpy.ops.screen.screenshot(filepath=path)
    else:
        real_blender.shot(path)


def coloured_pixels(name: str) -> int:
    """Take a picture and count the pixels in the middle of the viewport that are blue or green, not grey or red.

    The axes' lines and the gizmo are thin or outside of the middle.
    """
    import numpy as np

    shot(name)
    image = bpy.data.images.load(str(FOLDER / f"{name}.png"))
    try:
        width, height = image.size
        pixels = np.empty(width * height * 4, dtype=np.float32)
        image.pixels.foreach_get(pixels)
    finally:
        bpy.data.images.remove(image)
    over = region("WINDOW")
    left, bottom = over.x + over.width // 4, over.y + over.height // 4
    middle = pixels.reshape(height, width, 4)[bottom : bottom + over.height // 2, left : left + over.width // 2]
    red, others = middle[..., 0], middle[..., 1:3].max(axis=2)
    return int(np.count_nonzero(others > red + 0.05))

"""An approximation or a reconstruction in a process of its own, for owners that must stay responsive.

The owner writes the input into a folder and starts a plain Python (see `child`); arrays travel as ``.npy``
files in that folder, everything said on the way as one JSON object a line: progress and the end of the
work on the child's standard output, the wish to finish early on its standard input.  The child ends, and
removes the folder, when its standard input closes: a killed owner leaves nothing behind.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import shutil
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .errors import SparseSurfaceError, WorkerError
from .processes.child import close_streams, last_words, private_channels, start_child, stop_giving_way
from .progress import FINISH, Progress, Steps, run_to_end
from .reconstruction.evaluated import CloudArrays, CloudOutcome, reconstruct_arrays
from .settings import CloudSettings, Settings

if TYPE_CHECKING:
    from .approximation.result import Approximation

SECONDS_BETWEEN_MESSAGES = 0.05
SECONDS_BETWEEN_PREVIEWS = 0.5


@dataclass(frozen=True)
class MeshArrays:
    """A polygon mesh as flat arrays.

    Attributes
    ----------
    vertices
        (V, 3) positions in scene units.
    corners
        (C,) vertex of each polygon corner, polygon after polygon.
    sizes
        (F,) number of corners of each polygon.
    triangles
        (T, 3) vertices of the triangles that the polygons are split into.
    triangle_polygons
        (T,) polygon of each triangle.
    weights
        (V,) observation weights in [0, 1], or `None` where all are 1.
    """

    vertices: NDArray[np.float32]
    corners: NDArray[np.int32]
    sizes: NDArray[np.int32]
    triangles: NDArray[np.int32]
    triangle_polygons: NDArray[np.int32]
    weights: NDArray[np.float32] | None = None

    def polygons(self) -> NDArray[np.int32] | list[NDArray[np.int32]]:
        """Return the polygons as `approximate` takes them: (F, n), or a list where their sizes differ."""
        if self.sizes.size and np.all(self.sizes == self.sizes[0]):
            return self.corners.reshape(-1, int(self.sizes[0]))
        return np.split(self.corners, np.cumsum(self.sizes)[:-1]) if self.sizes.size else []


def approximate_arrays(arrays: MeshArrays, settings: Settings) -> Steps[Approximation]:
    """Do `approximate_steps` on flat arrays."""
    from .approximation.approximate import approximate_steps  # SciPy: not needed where only a child computes

    return approximate_steps(
        arrays.vertices,
        arrays.polygons(),
        settings,
        triangles=(arrays.triangles.astype(np.int64), arrays.triangle_polygons.astype(np.int64)),
        weights=None if arrays.weights is None else arrays.weights.astype(np.float64),
    )


@dataclass(frozen=True)
class StoredRepresentation:
    """A representation as the content of a file; nothing of it has been looked at (see `storage.from_bytes`)."""

    stored: bytes


@dataclass(frozen=True)
class Outcome:
    """What a job brings back: the fields of `Approximation` of the same names."""

    vertices: NDArray[np.float32]
    error: NDArray[np.float64]
    patch: NDArray[np.int32]
    domain_stretch: NDArray[np.float64]
    report: dict[str, Any]
    representation: StoredRepresentation
    history: NDArray[np.float32] | None = None
    creases: NDArray[np.int64] | None = None


_INPUT_ARRAYS = {
    "mesh": ("vertices", "corners", "sizes", "triangles", "triangle_polygons", "weights"),
    "cloud": ("points", "base_vertices", "corners", "sizes"),
}
_RESULT_ARRAYS = {
    "mesh": ("vertices", "error", "patch", "domain_stretch"),
    "cloud": ("vertices", "corners", "sizes", "error", "patch", "domain_stretch", "point_error", "point_weight"),
}
_OPTIONAL_ARRAYS = {"mesh": {"history": np.float32, "creases": np.int64}, "cloud": {}}
"""What a result may have, and the type in which it travels."""


def solve_arrays(arrays: MeshArrays | CloudArrays, settings: Settings) -> Steps[Approximation] | Steps[CloudOutcome]:
    """Approximate a mesh, or reconstruct a surface from points."""
    if isinstance(arrays, CloudArrays):
        return reconstruct_arrays(arrays, settings)
    return approximate_arrays(arrays, settings)


# The owner's side


@dataclass
class Job:
    """One approximation in a child process, as its owner sees it.

    Parameters
    ----------
    folder
        A folder that does not exist yet; it is removed when the job stops.
    python
        The command that starts a plain Python, with its options.

    Attributes
    ----------
    outcome
        The result, once the work is done.
    failure
        One sentence that says why there is no result, once the work has failed.

    Notes
    -----
    Only `poll`, called by the owner as often as it likes, changes the attributes; the thread that reads
    the child's output does nothing but fill a queue.
    """

    folder: Path
    python: Sequence[str] = (sys.executable,)
    outcome: Outcome | CloudOutcome | None = None
    failure: str = ""
    _kind: str = field(default="mesh", init=False, repr=False)
    _process: subprocess.Popen[bytes] | None = field(default=None, init=False, repr=False)
    _reader: threading.Thread | None = field(default=None, init=False, repr=False)
    _messages: queue.SimpleQueue[dict[str, Any] | None] = field(
        default_factory=queue.SimpleQueue, init=False, repr=False
    )

    @property
    def running(self) -> bool:
        """Whether the work goes on: started, and neither an outcome nor a failure known."""
        return self._process is not None and self.outcome is None and not self.failure

    def start(self, arrays: MeshArrays | CloudArrays, settings: Settings, *, previews: bool = False) -> None:
        """Write the input and start the child; with `previews` it sends the surface as it stands."""
        self.folder.mkdir(parents=True)
        try:
            self._write_input(arrays, settings, previews)
            self._process = self._start_child()
        except BaseException:
            self.stop()
            raise
        self._reader = threading.Thread(target=_read_lines, args=(self._process.stdout, self._messages), daemon=True)
        self._reader.start()

    def poll(self) -> Progress | None:
        """Take in what the child has said since the last call and return its newest progress, if any."""
        newest: Progress | None = None
        while self.running:
            try:
                message = self._messages.get_nowait()
            except queue.Empty:
                break
            if message is None:
                self.failure = self._reason_of_death()
            elif message["kind"] == "progress":
                newest = self._progress(message, newest)
            elif message["kind"] == "done":
                self.outcome = self._read_outcome()
            else:
                self.failure = message["text"]
        return newest

    def finish(self) -> None:
        """Ask the child to end early with the best result so far."""
        if self.running and self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):  # it has just ended by itself
                self._process.stdin.write(f"{FINISH}\n".encode())
                self._process.stdin.flush()

    def stop(self) -> None:
        """End the child, if it lives, and remove every trace of the job; may be called again and again."""
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            if self._reader is not None:
                self._reader.join()
            close_streams(process)
        shutil.rmtree(self.folder, ignore_errors=True)

    def _write_input(self, arrays: MeshArrays | CloudArrays, settings: Settings, previews: bool) -> None:
        job: dict[str, Any] = {"kind": "mesh", "settings": settings.as_dict(), "previews": previews}
        if isinstance(arrays, CloudArrays):
            job |= {"kind": "cloud", "cloud": arrays.cloud.as_dict(), "splits": arrays.splits}
        self._kind = job["kind"]
        for name in _INPUT_ARRAYS[self._kind]:
            array = getattr(arrays, name)
            if array is not None:
                np.save(self.folder / f"{name}.npy", array, allow_pickle=False)
        (self.folder / "job.json").write_text(json.dumps(job), encoding="utf-8")

    def _start_child(self) -> subprocess.Popen[bytes]:
        with open(self.folder / "log.txt", "wb") as log:
            return start_child("job", str(self.folder), python=self.python, stderr=log, cwd=self.folder, gives_way=True)

    def _progress(self, message: Mapping[str, Any], earlier: Progress | None) -> Progress:
        surface = earlier.surface if earlier is not None else None
        if message["preview"]:
            path = self.folder / message["preview"]
            shown = np.load(path, allow_pickle=False)
            path.unlink()
            surface = lambda: shown  # noqa: E731
        return Progress(message["stage"], message["fraction"], message["detail"], surface)

    def _read_outcome(self) -> Outcome | CloudOutcome:
        names = _RESULT_ARRAYS[self._kind]
        arrays = {name: np.load(self.folder / f"result_{name}.npy", allow_pickle=False) for name in names}
        done = json.loads((self.folder / "report.json").read_text(encoding="utf-8"))
        stored = StoredRepresentation((self.folder / "representation.npz").read_bytes())
        if self._kind == "cloud":
            return CloudOutcome(**arrays, splits=done["splits"], report=done["report"], representation=stored)
        kept = {name: self.folder / f"result_{name}.npy" for name in _OPTIONAL_ARRAYS[self._kind]}
        arrays |= {name: np.load(path, allow_pickle=False) for name, path in kept.items() if path.exists()}
        return Outcome(**arrays, report=done["report"], representation=stored)

    def _reason_of_death(self) -> str:
        with open(self.folder / "log.txt", "rb") as log:
            words = last_words(log)
        return f"The solver's process ended before its work was done{': ' if words else ''}{words}."


def _read_lines(stream: IO[bytes], messages: queue.SimpleQueue[dict[str, Any] | None]) -> None:
    for line in stream:
        with contextlib.suppress(ValueError):  # the last line of a killed child may be cut
            messages.put(json.loads(line))
    messages.put(None)


# The child's side


def serve(job_folder: str) -> int:
    """Run the job that the folder holds and tell its owner; return the process's exit code."""
    folder = Path(job_folder)
    incoming, outgoing = private_channels()
    send = _sender(outgoing)
    requests = _Requests(folder, incoming)
    try:
        _run(folder, send, requests)
        send(kind="done")
        return 0
    except (SparseSurfaceError, MemoryError) as error:
        send(kind="failed", text=str(error) or "There is not enough memory for this mesh.")
    except Exception as error:
        traceback.print_exc()
        send(kind="failed", text=str(WorkerError(f"The solver failed ({type(error).__name__}: {error}).")))
    return 1


def _run(folder: Path, send: Callable[..., None], requests: _Requests) -> None:
    job = json.loads((folder / "job.json").read_text(encoding="utf-8"))
    steps: Steps[Any] = solve_arrays(_read_input(folder, job), Settings.from_dict(job["settings"]))
    result = run_to_end(steps, _Reporter(folder, send, requests, job["previews"]))
    for name in _RESULT_ARRAYS[job["kind"]]:
        np.save(folder / f"result_{name}.npy", getattr(result, name), allow_pickle=False)
    for name, kind in _OPTIONAL_ARRAYS[job["kind"]].items():
        array = getattr(result, name)
        if array is not None:
            np.save(folder / f"result_{name}.npy", array.astype(kind), allow_pickle=False)
    result.representation.save(folder / "representation.npz")
    done = {"report": result.report, "splits": getattr(result, "splits", 1)}
    (folder / "report.json").write_text(json.dumps(done), encoding="utf-8")


def _read_input(folder: Path, job: Mapping[str, Any]) -> MeshArrays | CloudArrays:
    paths = {name: folder / f"{name}.npy" for name in _INPUT_ARRAYS[job["kind"]]}
    arrays = {name: np.load(path, allow_pickle=False) for name, path in paths.items() if path.exists()}
    if job["kind"] == "cloud":
        return CloudArrays(**arrays, cloud=CloudSettings(**job["cloud"]), splits=job["splits"])
    return MeshArrays(**arrays)


def _sender(outgoing: int) -> Callable[..., None]:
    channel = os.fdopen(outgoing, "w", encoding="utf-8")

    def send(**message: Any) -> None:
        channel.write(json.dumps(message) + "\n")
        channel.flush()

    return send


class _Requests:
    """What the owner says, read by a thread; the end of its words is the end of this process."""

    def __init__(self, folder: Path, incoming: int) -> None:
        self._folder = folder
        self._incoming = incoming
        self._finish = threading.Event()
        threading.Thread(target=self._listen, daemon=True).start()

    @property
    def newest(self) -> str | None:
        return FINISH if self._finish.is_set() else None

    def _listen(self) -> None:
        # Not buffered: a thread waiting in a buffer would abort the interpreter's regular end.
        while words := os.read(self._incoming, 4096):
            if FINISH.encode() in words:
                self._finish.set()
        stop_giving_way()
        os.chdir(self._folder.parent)
        shutil.rmtree(self._folder, ignore_errors=True)
        os._exit(1)


@dataclass
class _Reporter:
    """Passes progress on, not more often than an owner can use it, and the owner's requests back."""

    folder: Path
    send: Callable[..., None]
    requests: _Requests
    previews: bool
    _stage: str = ""
    _sent: float = 0.0
    _shown: float = 0.0
    _count: int = 0

    def __call__(self, step: Progress) -> str | None:
        now = time.monotonic()
        preview = self._preview(step, now)
        if preview or step.stage != self._stage or now - self._sent >= SECONDS_BETWEEN_MESSAGES:
            self._stage, self._sent = step.stage, now
            self.send(kind="progress", stage=step.stage, fraction=step.fraction, detail=step.detail, preview=preview)
        return self.requests.newest

    def _preview(self, step: Progress, now: float) -> str:
        if not self.previews or step.surface is None or now - self._shown < SECONDS_BETWEEN_PREVIEWS:
            return ""
        self._shown, self._count = now, self._count + 1
        name = f"preview_{self._count}.npy"
        np.save(self.folder / name, step.surface().astype(np.float32), allow_pickle=False)
        return name

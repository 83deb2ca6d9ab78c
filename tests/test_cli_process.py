"""The command as a process: signals at any moment, standard streams, special files, and always an end."""

from __future__ import annotations

import json
import os
import random
import signal
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

bpy_missing = subprocess.run([sys.executable, "-c", "import bpy"], capture_output=True).returncode != 0
pytestmark = [
    pytest.mark.skipif(bpy_missing, reason="the command line needs bpy"),
    pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc and sends signals"),
]

COMMAND = [sys.executable, "-m", "sparse_surface"]
QUICK = ["--iterations", "2", "--sweeps", "0", "--workers", "2"]
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


@pytest.fixture
def model(tmp_path: Path) -> Path:
    size = 16
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    lines = [f"v {a:.6f} {b:.6f} {0.2 * np.sin(4.0 * a):.6f}" for a, b in zip(x, y, strict=True)]
    lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in quads]
    path = tmp_path / "model.obj"
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.fixture
def scratch(tmp_path: Path) -> Iterator[dict[str, str]]:
    """An environment with a temporary folder of its own; it must be empty at the end."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    yield {**os.environ, "TMPDIR": str(folder)}
    assert list(folder.iterdir()) == []
    folder.rmdir()


def hears(process: subprocess.Popen[Any]) -> bool:
    """Whether the process catches SIGTERM: its own first lines have run."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)


def whole_run(model: Path, scratch: dict[str, str]) -> float:
    before = time.monotonic()
    done = subprocess.run(
        [*COMMAND, "approximate", model, "-o", model.with_name("first.ply"), *QUICK],
        env=scratch,
        capture_output=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return time.monotonic() - before


def interrupted(words: list[Any], scratch: dict[str, str], what: signal.Signals, after: float) -> int:
    """Send a signal to a command some seconds after it began to listen; return the exit code."""
    process = subprocess.Popen(
        [*COMMAND, *words],
        env=scratch,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        # What a shell runs in the background ignores interrupts, and so would what it starts.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    while not hears(process):
        time.sleep(0.001)
    time.sleep(after)
    process.send_signal(what)
    before = time.monotonic()
    _, said = process.communicate(timeout=30)
    assert time.monotonic() - before < 10.0
    assert process.returncode in (0, SIGNALS[what]), said
    assert said == ("sparse_surface: cancelled\n" if process.returncode else "")
    assert list(Path(scratch["TMPDIR"]).iterdir()) == []
    return process.returncode


@pytest.mark.parametrize("count", [9, pytest.param(200, marks=pytest.mark.long)])
def test_signals_at_any_moment(model: Path, scratch: dict[str, str], count: int) -> None:
    seconds, rng = whole_run(model, scratch), random.Random(1)
    folder = model.parent
    kept = sorted(path.name for path in folder.iterdir())
    for number in range(count):
        words = ["approximate", model, "-o", folder / "out.ply", *QUICK]
        interrupted(words, scratch, list(SIGNALS)[number % 3], rng.uniform(0.0, seconds))
        (folder / "out.ply").unlink(missing_ok=True)
        assert sorted(path.name for path in folder.iterdir()) == kept


def every_command(model: Path) -> dict[str, list[Any]]:
    """Words of a run of each command that works for a while, from a model and files that are made of it."""
    folder = model.parent
    rows = [line[2:] for line in model.read_text().splitlines() if line.startswith("v ")]
    (folder / "points.xyz").write_text("\n".join(rows) + "\n")
    out = ["-o", folder / "out.ply"]
    return {
        "approximate": ["approximate", model, *out, *QUICK, "--report", folder / "out.json"],
        "denoise": ["approximate", model, *out, *QUICK, "--denoise", "only", "--noise-level", "0.01"],
        "reconstruct": ["reconstruct", folder / "points.xyz", *out, *QUICK],
        "evaluate": ["evaluate", folder / "functions.npz", *out, "--resample", "16"],
    }


@pytest.mark.long
@pytest.mark.parametrize("command", ["approximate", "denoise", "reconstruct", "evaluate"])
def test_fifty_signals_to_each_command(model: Path, scratch: dict[str, str], command: str) -> None:
    folder, rng = model.parent, random.Random(command)
    words = every_command(model)[command]
    made = ["approximate", model, "--representation", folder / "functions.npz", *QUICK]
    for first in (made, words):
        before = time.monotonic()
        done = subprocess.run([*COMMAND, *first], env=scratch, capture_output=True, text=True, timeout=120)
        seconds = time.monotonic() - before
        assert done.returncode == 0, done.stderr
    outputs = [folder / name for name in ("out.ply", "out.json")]
    for path in outputs:
        path.unlink(missing_ok=True)
    kept = sorted(path.name for path in folder.iterdir())
    codes = []
    for number in range(50):
        codes.append(interrupted(words, scratch, list(SIGNALS)[number % 3], rng.uniform(0.0, seconds)))
        for path in outputs:
            path.unlink(missing_ok=True)
        assert sorted(path.name for path in folder.iterdir()) == kept
    assert set(codes) - {0}, "every signal came too late"
    print(command, {code: codes.count(code) for code in sorted(set(codes))})


def test_the_child_ends_with_a_guard_that_is_killed(model: Path, scratch: dict[str, str]) -> None:
    process = subprocess.Popen(
        [*COMMAND, "approximate", model, "-o", model.with_name("out.ply"), *QUICK],
        env=scratch,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline()
    process.kill()
    process.wait()
    process.stdout.read()  # ends when the child has closed its end
    deadline = time.monotonic() + 20.0
    while list(Path(scratch["TMPDIR"]).iterdir()) and time.monotonic() < deadline:
        time.sleep(0.05)


@pytest.mark.parametrize("stdout", ["closed", "full", "pipe without a reader"])
def test_results_are_written_whatever_happens_to_standard_output(
    model: Path, scratch: dict[str, str], stdout: str
) -> None:
    out, report = model.with_name("out.ply"), model.with_name("report.json")
    redirect = {"closed": ">&-", "full": "> /dev/full", "pipe without a reader": "| true"}[stdout]
    words = [*COMMAND, "approximate", str(model), "-o", str(out), "--report", str(report), *QUICK]
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", '"$@" ' + redirect, "-", *words],
        env=scratch,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert out.stat().st_size > 0
    assert json.loads(report.read_text())["patches"] > 0


def test_a_name_that_the_terminal_cannot_show(model: Path, scratch: dict[str, str]) -> None:
    umlaut = model.rename(model.with_name("ümlaut.obj"))
    out = model.with_name("out.ply")
    environment = {**scratch, "PYTHONIOENCODING": "ascii", "LC_ALL": "C"}
    done = subprocess.run(
        [*COMMAND, "approximate", umlaut, "-o", out, *QUICK], env=environment, capture_output=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert b"\\xfcmlaut: 256 vertices" in done.stdout
    assert out.exists()


def test_special_files_links_and_permissions(model: Path, scratch: dict[str, str]) -> None:
    folder = model.parent
    real, link, pipe, private = (folder / name for name in ("real.json", "link.json", "pipe", "private.ply"))
    real.write_text("old")
    link.symlink_to(real)
    os.mkfifo(pipe)
    private.write_text("old")
    private.chmod(0o600)
    arguments = ["approximate", str(model), *QUICK]
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE, text=True)
    for report, output in ((link, private), (pipe, folder / "out.ply"), (Path("/dev/null"), folder / "out.ply")):
        done = subprocess.run(
            [*COMMAND, *arguments, "--report", str(report), "-o", str(output)],
            env=scratch,
            capture_output=True,
            timeout=120,
        )
        assert done.returncode == 0, done.stderr
    assert link.is_symlink()
    assert json.loads(real.read_text())["patches"] > 0
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert json.loads(reader.communicate(timeout=10)[0])["patches"] > 0
    assert stat.S_ISCHR(Path("/dev/null").stat().st_mode)
    assert stat.S_IMODE(private.stat().st_mode) == 0o600
    assert private.read_bytes().startswith(b"ply")
    plain = folder / "out.ply"
    assert stat.S_IMODE(plain.stat().st_mode) & 0o400


def test_the_longest_name(model: Path, scratch: dict[str, str]) -> None:
    out = model.with_name("n" * 250 + ".ply")
    done = subprocess.run(
        [*COMMAND, "approximate", model, "-o", out, *QUICK], env=scratch, capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    assert out.exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["-o", "{folder}/same.json.ply", "--report", "{folder}/./same.json.ply"], "same file"),
        (["-o", "//x.ply"], "begins with //"),
        (["-o", "{folder}/" + 252 * "n" + ".ply"], "too long"),
        (["--report", "{folder}/locked/r.json"], "cannot be written"),
    ],
)
def test_outputs_that_cannot_be_are_refused_first(
    model: Path, scratch: dict[str, str], words: list[str], said: str
) -> None:
    locked = model.with_name("locked")
    locked.mkdir(mode=0o500)
    if "locked" in words[-1] and os.access(locked, os.W_OK):
        pytest.skip("this user may write everywhere")
    given = [word.format(folder=model.parent) for word in words]
    done = subprocess.run(
        [*COMMAND, "approximate", model, *given], env=scratch, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2
    assert said in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert sorted(path.name for path in model.parent.iterdir()) == ["locked", "model.obj", "tmp"]


DRIVER = """
import bpy, sys
bpy.ops.wm.read_homefile(use_empty=True)
bpy.ops.wm.obj_import(filepath=sys.argv[1])
curve = bpy.context.scene.objects[0].driver_add("location", 0)
curve.driver.type, curve.driver.expression = "SCRIPTED", "sin(frame) + bpy.context.scene.frame_current"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[2])
"""


def test_a_file_with_a_python_driver_lets_the_command_end(model: Path, scratch: dict[str, str]) -> None:
    scene, out = model.with_suffix(".blend"), model.with_name("out.obj")
    made = [sys.executable, "-c", DRIVER, model, scene]
    with suppress(subprocess.TimeoutExpired):  # what made it may not end either
        subprocess.run(made, capture_output=True, timeout=30, env={**scratch, "TMPDIR": "/tmp"})
    assert scene.exists()
    command = [*COMMAND, "approximate", scene, "-o", out, *QUICK]
    done = subprocess.run(command, env=scratch, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert out.exists()


@pytest.mark.parametrize("kilobytes", [300_000, 600_000, 900_000, 1_300_000, 2_500_000, 4_000_000])
def test_too_little_memory_is_one_sentence(model: Path, scratch: dict[str, str], kilobytes: int) -> None:
    command = [*COMMAND, "approximate", str(model), "-o", str(model.with_name("out.ply")), *QUICK]
    done = subprocess.run(
        ["bash", "-c", f'ulimit -v {kilobytes}; exec "$@"', "-", *command],
        env=scratch,
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode in (0, 1)
    if kilobytes < 2_000_000:
        assert done.returncode == 1
    assert len(done.stderr.splitlines()) == done.returncode
    assert ("memory" in done.stderr) == bool(done.returncode)


def test_a_stale_working_directory_reads_no_other_file(model: Path, scratch: dict[str, str]) -> None:
    """Blender takes a relative path from the folder that the environment names."""
    here, there = model.parent / "here", model.parent / "there"
    for folder, height in ((here, 0.0), (there, 7.0)):
        folder.mkdir()
        made = "import bpy, sys; bpy.ops.mesh.primitive_plane_add(location=(0, 0, float(sys.argv[2]))); " + (
            "bpy.ops.object.transform_apply(); bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])"
        )
        subprocess.run(
            [sys.executable, "-c", made, folder / "same.blend", str(height)],
            check=True,
            capture_output=True,
            env=scratch,
        )
    out = here / "out.obj"
    command = [*COMMAND, "approximate", "same.blend", "--object", "Plane", "-o", out, *QUICK]
    done = subprocess.run(
        command, env={**scratch, "PWD": str(there)}, cwd=here, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 0, done.stderr
    heights = {line.split()[3] for line in out.read_text().splitlines() if line.startswith("v ")}
    assert heights == {"0.000000"}


SQUEEZED = """
import os, resource, sys
from sparse_surface.command_line import progress
stage, spare = {stage!r}, {spare}
class Watching(progress._PlainLines):
    def __call__(self, step):
        super().__call__(step)
        if step.stage == stage:
            pages = int(open("/proc/self/statm").read().split()[0])
            resource.setrlimit(resource.RLIMIT_AS, 2 * (pages * os.sysconf("SC_PAGE_SIZE") + spare,))
progress._PlainLines = Watching
from sparse_surface.command_line.main import main
code = main(sys.argv[1:])
sys.stdout.flush()
os._exit(code)
"""


def squeezed(tmp_path: Path, stage: str, spare: int, output: str = "out.obj") -> subprocess.CompletedProcess[str]:
    """Approximate a mesh of 40,000 vertices, with little memory to spare from a stage on."""
    size = 200
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    points = np.stack([x, y, 0.1 * np.sin(9.0 * x) * np.cos(7.0 * y)], axis=1)
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    lines = [f"v {a:.6f} {b:.6f} {c:.6f}" for a, b, c in points]
    lines += ["f " + " ".join(map(str, face + 1)) for face in quads]
    (tmp_path / "wide.obj").write_text("\n".join(lines) + "\n")
    code = SQUEEZED.format(stage=stage, spare=spare)
    words = ["approximate", tmp_path / "wide.obj", "-o", tmp_path / output, "--report", tmp_path / "report.json"]
    command = [sys.executable, "-c", code, *words, "--iterations", "2", "--sweeps", "0", "--workers", "1"]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.mark.parametrize("stage", ["Bounding the error", "Blending", "Measuring"])
def test_a_finished_surface_is_written_where_memory_is_too_short_to_measure_it(tmp_path: Path, stage: str) -> None:
    done = squeezed(tmp_path, stage, 1 << 20)
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert line.startswith("sparse_surface: wide: There is not enough memory to measure the surface; ")
    before, after = (
        np.array([line.split()[1:] for line in path.read_text().splitlines() if line.startswith("v ")], dtype=float)
        for path in (tmp_path / "wide.obj", tmp_path / "out.obj")
    )
    away = np.linalg.norm(after - before, axis=1)
    assert 0.0 < away.max() < 1e-3
    assert not (tmp_path / "report.json").exists()


def test_a_scene_has_the_surface_where_memory_is_too_short_to_keep_its_functions(tmp_path: Path) -> None:
    done = squeezed(tmp_path, "Measuring", 24 << 20, "out.blend")
    assert done.returncode == 1, done.stderr
    (line,) = done.stderr.splitlines()
    assert "not enough memory" in line
    code = "import bpy, sys, os; bpy.ops.wm.open_mainfile(filepath=sys.argv[1])\n"
    code += "print(*bpy.data.objects.keys(), sep='|'); sys.stdout.flush(); os._exit(0)"
    command = [sys.executable, "-c", code, str(tmp_path / "out.blend")]
    listed = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert "wide Sparse Surface" in listed.stdout.splitlines()[-1].split("|")
    assert "wide Sparse Surface.001" not in listed.stdout


def test_too_little_memory_to_fit_is_one_sentence(tmp_path: Path) -> None:
    done = squeezed(tmp_path, "Parameterising patches", 1 << 20)
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "not enough memory" in line
    assert not (tmp_path / "out.obj").exists()

"""How the command line speaks: to people, to other programs, and to shells."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.command_line.console import Console, painted
from sparse_surface.solver import load

WITHOUT_BLENDER = (
    "import sys, importlib.util as u; plain = u.find_spec\n"
    "u.find_spec = lambda name, *rest: None if name == 'bpy' else plain(name, *rest)\n"
    "from sparse_surface.command_line.main import main; sys.exit(main(sys.argv[1:]))"
)
QUICK = ("--iterations", "2", "--sweeps", "0", "--workers", "1")


def command(*words: str | Path) -> list[str]:
    return [sys.executable, "-c", WITHOUT_BLENDER, *map(str, words)]


def run(*words: str | Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command(*words), capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, 10)], indexing="ij"))
    i = np.arange(100).reshape(10, 10)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    path = tmp_path_factory.mktemp("manners") / "model.npz"
    np.savez(path, vertices=np.stack([x, y, 0.2 * np.sin(4.0 * x)], axis=1), faces=quads)
    return path


@pytest.mark.parametrize("name", [None, "approximate", "reconstruct", "evaluate", "inspect", "compare", "distance"])
def test_help_and_guide_name_every_exit_code(name: str | None) -> None:
    said = run(*([name] if name else []), "--help").stdout.split("Exit codes:")[1]
    guide = (
        (Path(__file__).parents[1] / "docs" / "user-guide.md").read_text(encoding="utf-8").split("### Exit codes")[1]
    )
    codes = {"0", "1", "2", "129", "130", "143"}  # 128 and the signal's number, as shells count
    assert set(re.findall(r"\b\d+\b", said)) == codes
    assert set(re.findall(r"^\| (\d+) \|", guide, re.MULTILINE)) == codes


def test_json_is_all_that_standard_output_holds(model: Path, tmp_path: Path) -> None:
    report, surface = tmp_path / "report.json", tmp_path / "surface.npz"
    done = run("approximate", model, "--json", "--report", report, "--representation", surface, *QUICK)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads(report.read_text())
    assert "model: 100 vertices" in done.stderr
    listed = run("inspect", surface, "--json", "-q")
    assert [each["patch"] for each in json.loads(listed.stdout)] == list(range(json.loads(done.stdout)["patches"]))
    assert listed.stderr == ""
    fine = run("evaluate", surface, "--resample", "2", "-o", tmp_path / "fine.npz", "--json")
    assert json.loads(fine.stdout) == {"vertices": 19 * 19, "faces": 4 * 81}


def test_a_representation_may_give_up_the_order_of_its_mesh(model: Path, tmp_path: Path) -> None:
    kept, free = tmp_path / "kept.npz", tmp_path / "free.npz"
    assert run("approximate", model, "--representation", kept, *QUICK).returncode == 0
    assert run("approximate", model, "--representation", free, "--vertex-order", "free", *QUICK).returncode == 0
    one, two = load(kept), load(free)
    assert sorted(one.vertices.tolist()) == sorted(two.vertices.tolist())
    assert not np.array_equal(one.vertices, two.vertices)


def test_no_figures_are_printed_where_a_file_could_not_be_written(model: Path, tmp_path: Path) -> None:
    done = run("approximate", model, "--json", "-o", tmp_path / "out.step", *QUICK)
    assert done.returncode != 0
    assert done.stdout == ""


def test_quiet_and_verbose(model: Path) -> None:
    quiet, plain, verbose = (run("approximate", model, *flags, *QUICK) for flags in (("-q",), (), ("-v",)))
    assert [done.returncode for done in (quiet, plain, verbose)] == [0, 0, 0]
    assert quiet.stdout + quiet.stderr == ""
    assert "cover" not in plain.stdout.splitlines()[-1]
    times, means = verbose.stdout.splitlines()[-2:]
    assert times.startswith("  cover ")
    assert "workers: 1" in means
    both = run("approximate", model, "-q", "-v")
    assert both.returncode == 2
    refused = run("approximate", model.with_name("none.npz"), "-q")
    assert refused.returncode == 1
    assert refused.stderr.startswith("sparse_surface: ")


@pytest.mark.skipif(sys.platform == "win32", reason="takes a pseudo-terminal")
@pytest.mark.parametrize(
    ("variables", "coloured"),
    [({"TERM": "xterm"}, True), ({"TERM": "xterm", "NO_COLOR": "1"}, False), ({"TERM": "dumb"}, False)],
)
def test_colours_on_terminals_only(model: Path, variables: dict[str, str], coloured: bool) -> None:
    import pty  # Windows has none

    owner, terminal = pty.openpty()
    environment = {name: value for name, value in os.environ.items() if name not in ("TERM", "NO_COLOR")} | variables
    words = command("approximate", model.with_name("none.npz"))
    piped = subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120)
    shown = subprocess.run(words, env=environment, stdout=terminal, stderr=terminal, timeout=120)
    os.close(terminal)
    text = os.read(owner, 1 << 12).decode()
    os.close(owner)
    assert piped.returncode == shown.returncode == 1
    assert "\x1b" not in piped.stderr
    assert ("\x1b[31;1msparse_surface:\x1b[0m" in text) == coloured
    assert text.replace("\x1b[31;1m", "").replace("\x1b[0m", "").replace("\r\n", "\n") == piped.stderr


def test_the_name_of_a_result_stands_out(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    Console().say("a: b: 3 vertices", "a: b")
    assert capsys.readouterr().out == "\x1b[1ma: b\x1b[0m: 3 vertices\n"
    assert painted("x", "1", sys.stderr) == "x"


@pytest.mark.skipif(shutil.which("bash") is None, reason="asks bash")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("appr",), {"approximate"}),
        (("approximate", "--err"), {"--error-colors"}),
        (("approximate", "--preset", "pre"), {"precise"}),
        (("evaluate", "mo"), {"model.npz"}),
        (("approximate", "x.obj", "--report", "mo"), {"model.npz"}),
    ],
)
def test_a_shell_completes_words(model: Path, words: tuple[str, ...], expected: set[str]) -> None:
    pytest.importorskip("shtab", reason="an optional extra")
    script = run("--print-completion", "bash")
    assert script.returncode == 0, script.stderr
    ask = (
        f"{script.stdout}\n"
        f"COMP_WORDS=(sparse-surface {' '.join(words)}); COMP_CWORD={len(words)}\n"
        "line=($(complete -p sparse-surface)); for k in ${!line[@]}; do\n"
        '  [ "${line[$k]}" = -F ] && function=${line[$((k+1))]}\n'
        "done\n"
        f"$function sparse-surface {words[-1]}; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    done = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, timeout=60, cwd=model.parent)
    assert set(done.stdout.split()) == expected, done.stderr


def test_completion_says_what_it_takes() -> None:
    hide = "import sys; sys.modules['shtab'] = None\n"
    words = [sys.executable, "-c", hide + WITHOUT_BLENDER, "--print-completion", "bash"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120)
    assert done.returncode == 1
    assert done.stderr == 'sparse_surface: Completion takes shtab: pip install "sparse-surface[completion]".\n'

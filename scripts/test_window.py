"""Run the scripts of tests/window in a real Blender window.

    python scripts/test_window.py                        every script in every Blender that is found
    python scripts/test_window.py test_panel             one of them
    python scripts/test_window.py --but test_job         all but one of them
    python scripts/test_window.py --prepare              only install the Blenders, which takes minutes the first time
    python scripts/test_window.py --where-available --shared-machine --measure-once
                                                         as in CI: no failure if no Blender is found, times are judged
                                                         as on a machine that others use, too, and what does nothing
                                                         but measure them runs in the first Blender only
    python scripts/test_window.py --begin-within 1200    begin no script after twenty minutes, and name those left out

The Blender is the executable that the environment variable BLENDER names (it needs a display), or else the tool
../shared/tools/real-blender in its versions 5.2 and 4.3.  The extension is installed from the built zip into an empty
user folder, and each script gets a Blender of its own.  Pictures and logs are left in out/window/.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from build_extension import CHECKOUT, WITHOUT_WHEELS, BuildError, WheelError, build, this_platform

SCRIPTS = CHECKOUT / "tests" / "window"
OUT = CHECKOUT / "out" / "window"
TOOL = CHECKOUT.parent / "shared" / "tools" / "real-blender"
TOOL_VERSIONS = ("5.2", "4.3")
TIMEOUT = 600

MEASURING = ("test_first_picture", "test_responsiveness")
"""Scripts that do nothing but measure times."""


class Unavailable(Exception):
    """The machine has no such Blender, for a reason that is not this project's."""


@dataclass(frozen=True)
class Executable:
    """A Blender that is installed on this machine."""

    path: str
    name: str = "blender"

    # An official Blender comes without SciPy.
    zip_kind = this_platform()

    def set_up(self) -> None:
        """Nothing is to be done: who names a Blender has it."""

    def install(self, zip_path: Path, home: Path) -> None:
        command = [self.path, "--command", "extension", "install-file", "-r", "user_default", "-e", str(zip_path)]
        subprocess.run(command, check=True, env=self.environ(home), timeout=TIMEOUT)

    def run(self, script: Path, folder: Path, home: Path, log: Path, extra: Sequence[str]) -> int:
        command = [self.path, *event_options(script), "--python-exit-code", "1", "--python", str(script)]
        with log.open("wb") as file:
            done = subprocess.run(
                [*command, "--", str(folder), *extra], stdout=file, stderr=file, env=self.environ(home), timeout=TIMEOUT
            )
        return done.returncode

    @staticmethod
    def environ(home: Path) -> dict[str, str]:
        return {**os.environ, "BLENDER_USER_RESOURCES": str(home)}


@dataclass(frozen=True)
class ToolVersion:
    """A Blender that the tool runs, with the system's Python and SciPy, in a screen of its own."""

    version: str

    zip_kind = WITHOUT_WHEELS

    @property
    def name(self) -> str:
        return f"blender-{self.version}"

    def set_up(self) -> None:
        """Have the tool install this version where it is not yet; that takes minutes, a mirror and root."""
        try:
            subprocess.run([str(TOOL), self.version, "setup"], check=True, capture_output=True, timeout=TIMEOUT)
        except subprocess.TimeoutExpired as error:
            raise Unavailable(f"{TOOL.name} was not done with its set-up after {TIMEOUT} s") from error
        except (OSError, subprocess.CalledProcessError) as error:
            said = (getattr(error, "stderr", None) or b"").decode(errors="replace").strip().splitlines()
            raise Unavailable(said[-1] if said else str(error)) from error

    def install(self, zip_path: Path, home: Path) -> None:
        # The options come before Blender's own arguments.
        command = [str(TOOL), self.version, "run", "--home", str(home), "--bind", str(zip_path.parent)]
        install = ["--command", "extension", "install-file", "-r", "user_default", "-e", str(zip_path)]
        subprocess.run([*command, *install], check=True, timeout=TIMEOUT)

    def run(self, script: Path, folder: Path, home: Path, log: Path, extra: Sequence[str]) -> int:
        options = ["--home", str(home), "--bind", str(folder), "--shot", str(folder / "end.png")]
        command = [str(TOOL), self.version, "gui", str(script), *options, "--timeout", str(TIMEOUT)]
        with log.open("wb") as file:
            done = subprocess.run(
                [*command, *event_options(script), "--", str(folder), *extra], stdout=file, stderr=file, cwd=CHECKOUT
            )
        return done.returncode


def event_options(script: Path) -> list[str]:
    """Return the option that lets a script press keys, if it does.

    With it Blender's main loop never sleeps: one core is busy however idle the window is.  So what measures time or
    load does without.
    """
    presses = re.search(r"driver\.(press|click)\(|event_simulate\(", script.read_text(encoding="utf-8"))
    return ["--enable-event-simulate"] if presses else []


def blenders() -> list[Executable | ToolVersion]:
    """Return the Blenders to test on; empty if none is found."""
    named = os.environ.get("BLENDER")
    if named:
        return [Executable(named)]
    return [ToolVersion(version) for version in TOOL_VERSIONS] if TOOL.exists() else []


def prepare() -> None:
    """Install every Blender that can be had; say why another cannot."""
    for blender in blenders():
        try:
            blender.set_up()
        except Unavailable as error:
            print(f"{blender.name}: {error}", file=sys.stderr)


def run_scripts(
    blender: Executable | ToolVersion, scripts: list[Path], extra: Sequence[str] = (), until: float = math.inf
) -> list[tuple[str, int, float]]:
    """Install the extension afresh, run every script with `extra`; return name, exit code and seconds of each.

    None begins after `until`, by the monotonic clock; those that are left out are named.
    """
    place = OUT / blender.name
    shutil.rmtree(place, ignore_errors=True)
    home = place / "home"
    home.mkdir(parents=True)
    blender.install(build(blender.zip_kind, place), home)
    outcomes = []
    for script in scripts:
        if time.monotonic() > until:
            print(f"{blender.name}  {script.stem}: left out, for lack of time", flush=True)
            continue
        folder = place / script.stem
        folder.mkdir()
        start = time.perf_counter()
        try:
            code = blender.run(script, folder, home, folder / "log.txt", extra)
        except subprocess.TimeoutExpired:
            code = 124
        log = (folder / "log.txt").read_text(encoding="utf-8", errors="replace")
        passed = sum(line.startswith("passed ") for line in log.splitlines())
        if code == 0 and not passed:
            log += "\nNo test was run."
            code = 1
        outcomes.append((script.stem, code, time.perf_counter() - start))
        if code != 0:
            print(log[-6000:], flush=True)
        verdict = "ok" if code == 0 else f"FAILED (exit code {code})"
        print(f"{blender.name}  {script.stem}: {verdict}, {passed} tests, {outcomes[-1][2]:.0f} s", flush=True)
    shutil.rmtree(home)
    return outcomes


def main(arguments: list[str] | None = None) -> int:
    every = sorted(path.stem for path in SCRIPTS.glob("test_*.py"))
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scripts", nargs="*", choices=[[], *every], metavar="SCRIPT", help=", ".join(every))
    parser.add_argument("--but", nargs="+", default=[], choices=every, metavar="SCRIPT", help="leave these out")
    parser.add_argument("--where-available", action="store_true", help="do not fail where a Blender cannot be had")
    parser.add_argument("--shared-machine", action="store_true", help="let others' work come between in what is timed")
    parser.add_argument("--measure-once", action="store_true", help="measure times in the first Blender only")
    late = "begin no script later, and name those that are left out"
    parser.add_argument("--begin-within", type=float, default=math.inf, metavar="SECONDS", help=late)
    parser.add_argument("--prepare", action="store_true", help="install the Blenders and run nothing")
    options = parser.parse_args(arguments)
    if options.prepare:
        prepare()
        return 0
    extra = ["--shared-machine"] if options.shared_machine else []
    scripts = [SCRIPTS / f"{name}.py" for name in options.scripts or every if name not in options.but]
    codes: list[int] = []
    missing: list[str] = []
    until = time.monotonic() + options.begin_within
    try:
        for blender in blenders():
            try:
                blender.set_up()
            except Unavailable as error:
                missing.append(f"{blender.name}: {error}")
                continue
            codes += [code for _, code, _ in run_scripts(blender, scripts, extra, until)]
            if options.measure_once:
                scripts = [script for script in scripts if script.stem not in MEASURING]
    except (BuildError, WheelError, OSError, subprocess.SubprocessError) as error:
        print(error, file=sys.stderr)
        return 1
    if not codes and not missing and time.monotonic() <= until:
        missing.append("there is no Blender with a window; name one with BLENDER=/path/to/blender")
    for reason in missing:
        print(f"Window tests were not run: {reason}", file=sys.stderr)
    if codes:
        print(f"{codes.count(0)} passed, {len(codes) - codes.count(0)} failed")
    return 1 if any(codes) or (missing and not options.where_available) else 0


if __name__ == "__main__":
    sys.exit(main())

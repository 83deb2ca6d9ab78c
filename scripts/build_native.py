"""Build the compiled kernel of solver/native as a shared library.

    python scripts/build_native.py                          for this machine, with its C compiler (or CC)
    python scripts/build_native.py linux-x64 windows-x64    for these platforms, into build/native/, with zig
    python scripts/build_native.py --all                    for all platforms

zig comes from the package pinned in requirements/native.txt; it holds the headers and libraries of every platform.
"""

from __future__ import annotations

import argparse
import os
import platform
import runpy
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
SOURCES = CHECKOUT / "solver" / "native"
BUILT = CHECKOUT / "build" / "native"
ZIG = CHECKOUT / "wheels" / "zig"
LARGEST = 512 * 1024
"""Bytes that a library may have."""

# Sums may be reordered, so that they fit into vectors; infinities and NaN keep their meaning.
ARITHMETIC = ("-fno-math-errno", "-fno-trapping-math", "-fno-signed-zeros", "-fassociative-math", "-freciprocal-math")
# no exception passes through C, so what unwinding needs is left out
SMALLER = ("-fvisibility=hidden", "-fno-asynchronous-unwind-tables", "-fno-unwind-tables")
OPTIONS = ("-std=c11", "-O3", "-Wall", "-Wextra", "-ffp-contract=fast", *SMALLER, *ARITHMETIC)
WIDE = "-mprefer-vector-width=512"
# instruction set -> options for the machine's compiler and for zig
X64_SETS = {
    "baseline": (("-march=x86-64",), ("-mcpu=x86_64", "-Os")),  # for processors before 2013: less than half the size
    "avx2": (("-march=x86-64-v3",), ("-mcpu=x86_64_v3",)),
    "avx512": (("-march=x86-64-v4", WIDE), ("-mcpu=x86_64_v4", WIDE)),
}
OTHER_SETS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {"baseline": ((), ())}


@dataclass(frozen=True)
class Target:
    """A platform as zig calls it, and the end of a shared library's name there."""

    zig: str
    extension: str


TARGETS = {
    "linux-x64": Target("x86_64-linux-gnu.2.17", "so"),
    "linux-arm64": Target("aarch64-linux-gnu.2.17", "so"),
    "windows-x64": Target("x86_64-windows-gnu", "dll"),
    "macos-arm64": Target("aarch64-macos.12.0", "dylib"),
    "macos-x64": Target("x86_64-macos.10.13", "dylib"),
}


class NativeBuildError(Exception):
    """The kernel could not be built."""


def run(command: list[str], **variables: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, **variables})
    if done.returncode != 0:
        raise NativeBuildError(f"`{' '.join(command[:3])} ...` failed:\n{done.stdout}{done.stderr}")


def compile_into(library: Path, compiler: list[str], sets: dict[str, tuple[str, ...]], **variables: str) -> Path:
    """Compile the kernel once for each instruction set and link one library; it appears when it is complete."""
    library.parent.mkdir(parents=True, exist_ok=True)
    position = [] if library.suffix == ".dll" else ["-fPIC"]
    stamp = runpy.run_path(str(SOURCES / "stamp.py"))["source_stamp"](SOURCES)
    with tempfile.TemporaryDirectory(prefix=".native_", dir=library.parent) as folder:
        objects = []
        for name, options in [*sets.items(), ("processor", next(iter(sets.values())))]:
            source = SOURCES / ("processor.c" if name == "processor" else "kernel.c")
            objects.append(str(Path(folder) / f"{name}.o"))
            chosen = [*OPTIONS, *position, *options, f"-DINSTRUCTIONS={name}", f'-DSTAMP="{stamp}"']
            run([*compiler, *chosen, "-c", str(source), "-o", objects[-1]], **variables)
        draft = Path(folder) / library.name
        run([*compiler, "-shared", "-s", *next(iter(sets.values())), *objects, "-lm", "-o", str(draft)], **variables)
        if draft.stat().st_size > LARGEST:
            raise NativeBuildError(f"{library.name} has {draft.stat().st_size} bytes, more than {LARGEST}.")
        return draft.replace(library)


def compiler_of_this_machine() -> str | None:
    """The C compiler to build with: CC, or the first of the usual ones."""
    named = os.environ.get("CC")
    return named or next((found for name in ("cc", "gcc", "clang") if (found := shutil.which(name))), None)


def library_here() -> Path:
    """Where the library of this machine lies: where solver/native/library.py looks for it."""
    return SOURCES / "built" / f"libkernel.{ {'win32': 'dll', 'darwin': 'dylib'}.get(sys.platform, 'so') }"


def is_current(library: Path) -> bool:
    """Whether a library is newer than everything it is made from."""
    made_from = [*SOURCES.glob("*.[ch]"), SOURCES / "stamp.py", Path(__file__)]
    return library.is_file() and all(library.stat().st_mtime >= path.stat().st_mtime for path in made_from)


def build_here() -> Path | None:
    """Build the library of this machine; None where there is no C compiler.

    Raises
    ------
    NativeBuildError
        With the compiler's own words.
    """
    compiler = compiler_of_this_machine()
    if compiler is None:
        return None
    if is_current(library_here()):
        return library_here()
    x64 = platform.machine().lower() in ("x86_64", "amd64")
    sets = {name: own for name, (own, _) in (X64_SETS if x64 else OTHER_SETS).items()}
    return compile_into(library_here(), compiler.split(), sets)


def zig_command() -> list[str]:
    """Zig's C compiler, from the cache or fetched."""
    if not (ZIG / "ziglang").is_dir():
        print("Fetching zig ...", flush=True)
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-deps"]
        requirements = CHECKOUT / "requirements" / "native.txt"
        run([*pip, "--require-hashes", f"--requirement={requirements}", f"--target={ZIG}"])
    return [sys.executable, "-m", "ziglang", "cc"]


def build_for(name: str) -> Path:
    """Build the library of a platform with zig, into build/native/.

    Raises
    ------
    NativeBuildError
        With the compiler's own words.
    """
    target = TARGETS[name]
    library = BUILT / name / f"libkernel.{target.extension}"
    if is_current(library):
        return library
    sets = {name: own for name, (_, own) in (X64_SETS if "x64" in name else OTHER_SETS).items()}
    cache = str(CHECKOUT / "build" / "zig-cache")
    variables = {"PYTHONPATH": str(ZIG), "ZIG_GLOBAL_CACHE_DIR": cache, "ZIG_LOCAL_CACHE_DIR": cache}
    return compile_into(library, [*zig_command(), "-target", target.zig], sets, **variables)


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("platforms", nargs="*", choices=[[], *TARGETS], metavar="PLATFORM", help=", ".join(TARGETS))
    parser.add_argument("--all", action="store_true", help="for all platforms")
    parser.add_argument("--if-needed", action="store_true", help="say nothing where nothing was to be built")
    options = parser.parse_args(arguments)
    if options.if_needed and (is_current(library_here()) or compiler_of_this_machine() is None):
        return 0
    try:
        named = list(TARGETS) if options.all else options.platforms
        built = [build_for(name) for name in named] if named else [build_here()]
    except NativeBuildError as error:
        print(error, file=sys.stderr)
        return 1
    for library in built:
        if library is None:
            print("There is no C compiler here: NumPy fits the patches, without the compiled kernel.")
        else:
            print(f"{library.relative_to(CHECKOUT)}  {library.stat().st_size / 1e6:.2f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())

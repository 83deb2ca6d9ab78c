"""The compiled kernel as a shared library: where it lies, which instructions it may use, why it cannot be used.

A plain shared library loaded by `ctypes` knows nothing of Python or NumPy: one file a platform serves every version of
both, and Python's lock is free while it works.
"""

from __future__ import annotations

import ctypes
import platform
import sys
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from ..patch_methods import METHODS
from ..settings import Settings

EXTENSIONS = {"win32": "dll", "darwin": "dylib"}
"""Ends of the names of shared libraries; "so" elsewhere."""

INSTRUCTION_SETS = ("baseline", "avx2", "avx512")
"""Sets that the kernel is compiled for on x86-64, in the order of `instruction_set`; elsewhere only the first.

They add up in different orders, so their results differ by rounding; on one machine they are always the same.
"""


class NativeSettings(ctypes.Structure):
    """`Settings` of kernel.h."""

    _fields_ = (
        ("sparsity", ctypes.c_int64),
        ("iterations", ctypes.c_int64),
        ("legendre", ctypes.c_int64),
        ("ols", ctypes.c_int64),
        ("beta1", ctypes.c_double),
        ("beta2", ctypes.c_double),
        ("rigidity_decay", ctypes.c_double),
    )


def path() -> Path:
    """Where the library lies, under the name that the platform wants.

    It has a folder of its own: among the modules it would be taken for one.  A package for several platforms has a
    folder for each in there.
    """
    built, name = Path(__file__).parent / "built", f"libkernel.{EXTENSIONS.get(sys.platform, 'so')}"
    several = built / platform_name() / name
    return several if several.is_file() else built / name


def platform_name() -> str:
    """Name of system and processor as Blender's extensions know it, such as "linux-x64"."""
    system = {"win32": "windows", "darwin": "macos"}.get(sys.platform, sys.platform)
    machine = platform.machine().lower()
    return f"{system}-{ {'x86_64': 'x64', 'amd64': 'x64', 'aarch64': 'arm64'}.get(machine, machine) }"


def reason_against() -> str | None:
    """Why the compiled kernel cannot be used, as a sentence; None where it can."""
    return _loaded()[1]


def reason_for_numpy(settings: Settings) -> str | None:
    """Why NumPy fits the patches of a run with these resolved settings, as a sentence; None where the kernel does."""
    if settings.solver == "numpy":
        return "The settings ask for NumPy."
    if not METHODS[settings.method].compiled:
        return f"The compiled kernel does not solve the method {settings.method!r}."
    if settings.pursuit == "sklearn":
        return "The compiled kernel has pursuits of its own, not scikit-learn's."
    if settings.automatic_sparsity:
        return "The compiled kernel does not choose the sparsity by itself."
    return reason_against()


@lru_cache(maxsize=1)
def _loaded() -> tuple[ctypes.CDLL | None, str | None]:
    if not path().is_file():
        return None, f"The compiled kernel has not been built for {sys.platform} on {platform.machine()}."
    try:
        library = ctypes.CDLL(str(path()))
    except OSError as error:
        return None, f"The compiled kernel cannot be loaded: {error}."
    from .stamp import source_stamp  # the kernel is loaded to solve, this module whenever the add-on is enabled

    expected = source_stamp(Path(__file__).parent)
    if expected is not None and _stamp(library) != expected:
        return None, "The compiled kernel was built from other sources: run scripts/build_native.py again."
    return library, None


def _stamp(library: ctypes.CDLL) -> str | None:
    """What the library says of the sources that it was built from; None where it is too old to say it."""
    try:
        stamp = library.source_stamp
    except AttributeError:
        return None
    stamp.restype = ctypes.c_char_p
    found: bytes = stamp()
    return found.decode()


@cache
def function(name: str, instructions: str | None = None) -> Any:
    """A function of the library, for the best instruction set that this processor has, or for another one.

    It is looked up once: virtual machines take their time to say which instructions a processor has.

    Raises
    ------
    RuntimeError
        Where the kernel cannot be used.
    """
    library, reason = _loaded()
    if library is None:
        raise RuntimeError(reason)
    return library[f"{name}_{instructions or INSTRUCTION_SETS[library.instruction_set()]}"]


def supported_sets() -> tuple[str, ...]:
    """Instruction sets that the kernel was compiled for and this processor has; none where there is no kernel."""
    library, _ = _loaded()
    return () if library is None else INSTRUCTION_SETS[: library.instruction_set() + 1]

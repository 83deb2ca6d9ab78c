"""Results of the solver as they were recorded: a change of the code's structure must not change a byte of them.

    python tests/solver/reference_results.py            compare
    python tests/solver/reference_results.py --record   record, after a change that is meant to change bytes

Rounding differs between processors and libraries.  So hashes are compared only on machines of a kind on which they
were recorded, and elsewhere a few figures of each result are: they have to be, to the digits that rounding leaves
alone, those of one kind of machine.  Where two functions are equally good, rounding decides which one is taken; the
cube's error differs by four percent between processors with and without AVX-512.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from noisy import with_noise
from sparse_surface.benchmarks import generated_clouds as clouds
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import CloudSettings, Settings, approximate, reconstruct
from threadpoolctl import threadpool_info

RECORD = Path(__file__).with_suffix(".json")
ROUNDING = 1e-3
"""Share by which errors may differ between machines."""

VARYING = ("seconds", "peak_memory_mb", "workers", "numpy_reason")
ARRAYS = (
    "vertices",
    "error",
    "patch",
    "domain_stretch",
    "history",
    "creases",
    "triangle",
    "barycentric",
    "weights",
)


def machine() -> str:
    """What decides how sums are rounded."""
    blas = sorted(
        {
            f"{library['version']} {library['architecture']}"
            for library in threadpool_info()
            if library["user_api"] == "blas"
        }
    )
    features = [name for name in ("AVX2", "AVX512F", "AVX512_SKX", "NEON") if _has(name)]
    return " ".join([platform.machine(), "numpy", np.__version__, "scipy", scipy.__version__, *blas, *features])


def _has(feature: str) -> bool:
    core = getattr(np, "_core", None) or np.core
    return bool(core._multiarray_umath.__cpu_features__.get(feature))


def _mesh(model: Callable[[], Any], noise: float = 0.0, **settings: Any) -> Callable[[int], Any]:
    def run(workers: int) -> Any:
        vertices, faces = model()
        if noise:
            vertices = with_noise(vertices, faces, noise, 7)
        return approximate(vertices, faces, Settings(**settings, solver="numpy", workers=workers))

    return run


def _cloud(cloud: Callable[[], Any], options: dict[str, Any] | None = None, **settings: Any) -> Callable[[int], Any]:
    def run(workers: int) -> Any:
        made = cloud()
        base = made.base_vertices, made.base_faces
        by_numpy = Settings(**settings, solver="numpy", workers=workers)
        return reconstruct(made.points, *base, by_numpy, CloudSettings(**(options or {})))

    return run


def _small_ball() -> Any:
    return clouds.ball(noise=0.005)


CASES: dict[str, Callable[[int], Any]] = {
    "cube": _mesh(models.cube),
    "flower": _mesh(models.flower),
    "sphere_separate": _mesh(lambda: models.sphere(8), domains="separate"),
    "cube_paper": _mesh(lambda: models.cube(10), method="paper", sweeps=2, iterations=6, keep_iterations=True),
    "cube_traditional": _mesh(lambda: models.cube(10), method="traditional", sweeps=1),
    "cube_tolerance": _mesh(lambda: models.cube(10), tolerance=5e-4, mark_creases=True),
    "cube_uniform": _mesh(
        lambda: models.cube(8), blending="uniform", basis="monomial", automatic_sparsity=True, ring=4
    ),
    "moebius_pinned": _mesh(models.moebius, pin_boundary=True, sweeps=2),
    "noisy_cube_denoised": _mesh(models.cube, noise=0.003, denoise="only"),
    "noisy_cube_first": _mesh(lambda: models.cube(10), noise=0.003, denoise="first", iterations=4),
    "ball": _cloud(clouds.ball),
    "noisy_ball_robust": _cloud(_small_ball, {"robust": "tukey"}, iterations=6),
}


def _plain(report: dict[str, Any]) -> dict[str, Any]:
    kept = {name: value for name, value in report.items() if name not in VARYING}
    kept["settings"] = {name: value for name, value in kept["settings"].items() if name not in ("workers", "solver")}
    return _rounded(kept)


def _rounded(value: Any) -> Any:
    """Measures to 12 digits: NumPy's sums differ in the last one with the place of an array in memory."""
    if isinstance(value, dict):
        return {name: _rounded(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_rounded(part) for part in value]
    return float(f"{value:.11e}") if isinstance(value, float) else value


def digest(result: Any) -> dict[str, Any]:
    """A hash of everything that a result holds, and figures that do not depend on rounding."""
    hashed = hashlib.sha256()
    for name in (
        "vertices",
        "error",
        "patch",
        "domain_stretch",
        "history",
        "creases",
        "triangle",
        "barycentric",
        "weights",
    ):
        value = getattr(result, name, None)
        if value is not None:
            hashed.update(name.encode() + np.ascontiguousarray(value).tobytes())
    hashed.update(bytes(result.representation.stored))
    report = _plain(dict(result.report))
    hashed.update(json.dumps(report, sort_keys=True).encode())
    figures = {
        "patches": report["patches"],
        "vertex_rms": report["vertex_error"]["rms"],
        "surface_rms": report["surface_error"]["rms"],
        "keys": sorted(report),
    }
    return {"hash": hashed.hexdigest(), **figures}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--record", action="store_true")
    parser.add_argument("names", nargs="*", help="some cases; all where there are none")
    options = parser.parse_args()
    machines = json.loads(RECORD.read_text())["machines"] if RECORD.exists() else {}
    own = machines.setdefault(machine(), {})
    changed = 0
    for name in options.names or CASES:
        found = digest(CASES[name](1))
        before = own.get(name)
        same = before == found
        changed += not same
        print(f"{name}: {'as recorded' if same else 'CHANGED'}", flush=True)
        if not same:
            print(f"   {before}\n   {found}")
            own[name] = found
            for other in machines.values():
                if other is not own:
                    forget(other, name, before, found)
    if options.record:
        RECORD.write_text(json.dumps({"machines": machines}, indent=1, sort_keys=True) + "\n")
    return 0 if options.record or not changed else 1


def forget(results: dict[str, Any], name: str, before: dict[str, Any] | None, now: dict[str, Any]) -> None:
    """Forget of another machine's result what changed here: its bytes, and the whole result if its figures did."""
    if name not in results or before is None:
        return
    results[name]["hash"] = ""
    if not alike(before, now):
        del results[name]


def alike(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Whether two results have the same figures but for rounding."""
    same = all(one[key] == other[key] for key in ("keys", "patches"))
    return same and all(
        abs(one[key] - other[key]) <= ROUNDING * other[key] + 1e-9 for key in ("vertex_rms", "surface_rms")
    )


if __name__ == "__main__":
    sys.exit(main())

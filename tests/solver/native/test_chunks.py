"""Whole fits of the compiled kernel against those of NumPy."""

from __future__ import annotations

import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sparse_surface.benchmarks.generated_models import sphere
from sparse_surface.solver import approximate
from sparse_surface.solver.arrays import Array, Indices
from sparse_surface.solver.fitting import chunks as by_numpy
from sparse_surface.solver.fitting import native_chunks as chunks
from sparse_surface.solver.fitting.batch import Problem, WarmStart
from sparse_surface.solver.fitting.chunks import ChunkTask, PatchFit
from sparse_surface.solver.native import library
from sparse_surface.solver.native.stamp import source_stamp
from sparse_surface.solver.settings import Settings
from synthetic import crease, hill, problem

SETTINGS = {
    "defaults": {},
    "constant": {"degree": 0, "sparsity": 3},
    "one function": {"sparsity": 1},
    "many functions": {"degree": 20, "sparsity": 40},
    "highest degree": {"degree": 30, "sparsity": 60, "iterations": 4},
    "monomials": {"basis": "monomial", "degree": 8, "sparsity": 10},
    "matching pursuit": {"pursuit": "omp"},
    "no iterations": {"iterations": 0},
    "annealing cut short": {"iterations": 3},
    "many iterations": {"iterations": 40},
    "free domains": {"beta1": 0.0, "beta2": 0.0, "iterations": 5},
    "stiff domains": {"beta1": 1e3, "beta2": 1e3},
}
TIPPING = {"matching pursuit"}
"""Where rounding decides between functions that are almost as good: NumPy's own fits differ by tenths where values
differ in their thirteenth digit, and so on each machine.  The kernel's have to lie among those."""


def problems(settings: Settings, **changes: object) -> list[Problem]:
    """Eight patches with a crease or a hill."""
    made = [
        problem(crease if seed % 2 else hill, side=9 + seed % 4, seed=seed, scale=0.7, inside=True) for seed in range(8)
    ]
    return [replace(one, degree=min(one.degree, settings.degree), **changes) for one in made]  # type: ignore[arg-type]


def task_of(given: list[Problem], settings: Settings, each: int = 1) -> ChunkTask:
    return ChunkTask(np.arange(len(given) // each), given, settings)


def both(task: ChunkTask, instructions: str) -> tuple[list[PatchFit], list[PatchFit]]:
    """Return the fits of NumPy and of the kernel."""
    return by_numpy.fit_chunk(task), chunks.fit_natively(task, instructions)


def rms(given: list[Problem], fits: list[PatchFit]) -> float:
    squares = [((fit.values - one.values) ** 2).sum(axis=1) for one, fit in zip(given, fits, strict=True)]
    return float(np.sqrt(np.concatenate(squares).mean()))


def warm(given: list[Problem], fits: list[PatchFit]) -> list[Problem]:
    return [
        replace(one, warm=WarmStart(fit.frames[0], fit.domain[0], fit.support))
        for one, fit in zip(given, fits, strict=True)
    ]


def by_perturbed_numpy(given: list[Problem], settings: Settings) -> list[list[PatchFit]]:
    """Fits of NumPy to values that differ in their thirteenth digit, ten times."""
    found = []
    for seed in range(10):
        rng = np.random.default_rng(seed)
        moved = [replace(one, values=one.values * (1.0 + 1e-13 * rng.normal(size=one.values.shape))) for one in given]
        found.append(by_numpy.fit_chunk(task_of(moved, settings)))
    return found


@pytest.mark.parametrize("name", SETTINGS)
def test_errors_and_energies_are_those_of_numpy(instructions: str, name: str) -> None:
    settings = Settings(**SETTINGS[name]).resolved()  # type: ignore[arg-type]
    given = problems(settings)
    expected, fits = both(task_of(given, settings), instructions)
    spread = by_perturbed_numpy(given, settings) if name in TIPPING else [expected]
    errors = np.array([rms(given, each) for each in spread])
    assert abs(rms(given, fits) - errors.mean()) <= 5e-3 * errors.mean() + 1e-9 + 4.0 * errors.std()
    energies = np.array([[fit.energy[-1] for fit in each] for each in spread])
    for fit, other, energy in zip(fits, expected, energies.T, strict=True):
        assert fit.energy.shape == fit.squared_error.shape == (max(settings.iterations, 1),)
        assert abs(fit.energy[-1] - energy.mean()) <= 0.1 * energy.mean() + 1e-9 + 4.0 * energy.std()
        np.testing.assert_allclose(fit.initial_domain, other.initial_domain, atol=1e-9)


def test_early_iterations_are_those_of_numpy_to_many_digits(instructions: str) -> None:
    """Before rounding has grown, the two differ by nothing else."""
    settings = Settings(iterations=2).resolved()
    given = problems(settings)
    expected, fits = both(task_of(given, settings), instructions)
    for fit, other in zip(fits, expected, strict=True):
        np.testing.assert_allclose(fit.energy, other.energy, rtol=1e-4)
        np.testing.assert_allclose(fit.squared_error, other.squared_error, rtol=1e-3)
        assert np.abs(fit.domain - other.domain).max() < 1e-3


def test_what_a_fit_says_agrees_with_itself(instructions: str) -> None:
    """Values, squared errors and history follow from domain, support and coefficients."""
    settings = Settings(keep_iterations=True).resolved()
    given = problems(settings)
    for one, fit in zip(given, chunks.fit_natively(task_of(given, settings), instructions), strict=True):
        assert fit.history is not None
        assert fit.history.shape == (15, len(one.domain), 3)
        vertices = len(one.domain)  # the first observations are the vertices
        np.testing.assert_allclose(fit.history[-1], fit.values[:vertices], atol=1e-6)
        assert fit.squared_error[-1] == pytest.approx(((fit.values - one.values) ** 2).sum(), rel=1e-3)
        assert (np.diff(fit.energy[8:]) <= 1e-12).all()


def doubled_areas(domain: Array, triangles: Indices) -> Array:
    a, b, c = (domain[triangles[:, k]] for k in range(3))
    return (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]


def test_no_triangle_shrinks_to_less_than_a_fiftieth(instructions: str) -> None:
    """Linear functions fit plateaus only over a domain that shrinks each of them to a point."""
    flat = problem(lambda u, v: 0.0 * u, 12, degree=1)
    plateaus = np.tanh(6.0 * flat.signals)
    settings = Settings(degree=1, iterations=60, beta1=1e-9, beta2=0.0).resolved()
    task = task_of([replace(flat, signals=plateaus, values=plateaus)], settings)
    fit = chunks.fit_natively(task, instructions)[0]
    shares = doubled_areas(fit.domain[0], flat.triangles) / doubled_areas(fit.initial_domain[0], flat.triangles)
    assert shares.min() >= 0.02 - 1e-9
    assert shares.min() < 0.03, "nothing came near the floor"


def test_sweeps_continue_from_earlier_solutions_as_with_numpy(instructions: str) -> None:
    settings = Settings().resolved()
    given = problems(settings)
    first = by_numpy.fit_chunk(task_of(given, settings))
    rng = np.random.default_rng(0)
    moved = [replace(one, values=one.values + rng.normal(0.0, 1e-3, one.values.shape)) for one in warm(given, first)]
    expected, fits = both(task_of(moved, settings), instructions)
    assert rms(moved, fits) == pytest.approx(rms(moved, expected), rel=5e-3)
    for fit, before in zip(fits, first, strict=True):
        np.testing.assert_array_equal(fit.support, before.support)
        assert fit.energy.size == fit.squared_error.size == 0


def test_separate_domains(instructions: str) -> None:
    settings = Settings(domains="separate").resolved()
    whole = problems(settings)
    given = [
        replace(one, signals=one.signals[:, d : d + 1], values=one.values[:, d : d + 1])
        for one in whole
        for d in range(3)
    ]
    expected, fits = both(task_of(given, settings, 3), instructions)
    assert rms(whole, fits) == pytest.approx(rms(whole, expected), rel=5e-3)
    for fit, other in zip(fits, expected, strict=True):
        assert fit.domain.shape == other.domain.shape
        assert len(fit.frames) == 3
        assert fit.support.shape == fit.coefficients.shape == (3, 15)


def test_noisy_observations_take_as_few_functions_as_with_numpy(instructions: str) -> None:
    settings = Settings().resolved()
    rng = np.random.default_rng(4)
    given = [
        replace(one, noise=0.02, values=one.values + rng.normal(0.0, 0.02, one.values.shape))
        for one in problems(settings)
    ]
    expected, fits = both(task_of(given, settings), instructions)
    counts = [sum(int((fit.support >= 0).sum()) for fit in some) for some in (fits, expected)]
    assert counts[0] < 8 * 3 * 15
    assert counts[0] == pytest.approx(counts[1], rel=0.1)
    assert rms(given, fits) == pytest.approx(rms(given, expected), rel=2e-2)


def test_fewer_observations_than_functions(instructions: str) -> None:
    settings = Settings().resolved()
    given = [replace(problem(hill, side=3, seed=seed), degree=14) for seed in range(3)]
    for one, fit in zip(given, chunks.fit_natively(task_of(given, settings), instructions), strict=True):
        assert fit.support.shape == (3, 9)
        assert np.abs(fit.values - one.values).max() < 1e-6


def test_unweighted_observations_and_lower_degrees(instructions: str) -> None:
    settings = Settings().resolved()
    given = [
        replace(one, degree=5, weights=np.where(np.arange(len(one.weights)) % 3, one.weights, 0.0))
        for one in problems(settings)
    ]
    expected, fits = both(task_of(given, settings), instructions)
    assert rms(given, fits) == pytest.approx(rms(given, expected), rel=5e-3)
    assert max(fit.support.max() for fit in fits) < 21


@pytest.mark.parametrize("scale", [1e-7, 1e7])
def test_the_scene_unit_does_not_matter(instructions: str, scale: float) -> None:
    settings = Settings(iterations=4).resolved()
    plain = [problem(crease, seed=1, inside=True)]
    scaled = [replace(problem(crease, seed=1, inside=True, scale=scale))]
    fit, other = (chunks.fit_natively(task_of(some, settings), instructions)[0] for some in (plain, scaled))
    assert rms(scaled, [other]) == pytest.approx(rms(plain, [fit]) * scale, rel=1e-2)


def degenerate(kind: str) -> Problem:
    made = problem(hill, inside=True)
    if kind == "one point":
        return replace(made, domain=np.zeros_like(made.domain), signals=0.0 * made.signals, values=0.0 * made.values)
    if kind == "flat domain":
        return replace(made, domain=made.domain * [1.0, 0.0])
    if kind == "no weights":
        return replace(made, weights=np.zeros_like(made.weights))
    return replace(made, values=made.values * 1e150)


@pytest.mark.parametrize("kind", ["one point", "flat domain", "no weights", "huge"])
def test_degenerate_patches_end_with_finite_numbers(instructions: str, kind: str) -> None:
    fit = chunks.fit_natively(task_of([degenerate(kind)], Settings().resolved()), instructions)[0]
    assert np.isfinite(fit.domain).all()
    assert np.isfinite(fit.values).all()
    assert np.isfinite(fit.coefficients).all()


def as_bytes(fits: list[PatchFit]) -> list[bytes]:
    return [b"".join(a.tobytes() for a in (fit.domain, fit.coefficients, fit.values, fit.energy)) for fit in fits]


def test_fits_are_the_same_bytes_alone_together_and_in_threads(instructions: str) -> None:
    settings = Settings().resolved()
    given = problems(settings)
    together = as_bytes(chunks.fit_natively(task_of(given, settings), instructions))

    def fit(one: Problem) -> bytes:
        return as_bytes(chunks.fit_natively(task_of([one], settings), instructions))[0]

    with ThreadPoolExecutor(3) as executor:
        alone = list(executor.map(fit, [one for one in given for _ in range(2)]))
    assert alone[::2] == alone[1::2] == together


def test_arrays_that_contradict_each_other_are_refused(instructions: str) -> None:
    settings = Settings().resolved()
    one = problem(hill, inside=True)
    corners = one.corners.copy()
    corners[-1] = [0, 1, len(one.domain) - 1]
    with pytest.raises(ValueError, match="contradict"):
        chunks.fit_natively(task_of([replace(one, corners=corners)], settings), instructions)
    fit = chunks.fit_natively(task_of([one], settings), instructions)[0]
    wrong = replace(warm([one], [fit])[0], degree=1)
    with pytest.raises(ValueError, match="contradict"):
        chunks.fit_natively(task_of([wrong], settings), instructions)


WITHOUT_MEMORY = """
import resource, sys
sys.path.insert(0, {folder!r})
import numpy as np
from dataclasses import replace
from pathlib import Path
from sparse_surface.solver.fitting.chunks import ChunkTask
from sparse_surface.solver.fitting import native_chunks as chunks
from sparse_surface.solver.settings import Settings
from synthetic import hill, problem
settings = Settings(degree=30, sparsity=496).resolved()
one = replace(problem(hill, side=60, inside=True), degree=30)
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + (64 << 20),) * 2)
try:
    chunks.fit_natively(ChunkTask(np.arange(1), [one], settings))
except MemoryError as error:
    print(error)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits a process's memory as Linux does")
@pytest.mark.skipif(library.reason_against() is not None, reason=str(library.reason_against()))
def test_without_memory_a_sentence_says_so() -> None:

    script = WITHOUT_MEMORY.format(folder=str(Path(__file__).parent.parent))
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.startswith("There is not enough memory for a patch of 3600 vertices"), done.stderr


def test_the_reason_for_numpy_is_a_sentence() -> None:
    assert "'paper'" in str(library.reason_for_numpy(Settings(method="paper").resolved()))
    assert "sparsity" in str(library.reason_for_numpy(Settings(automatic_sparsity=True).resolved()))
    assert library.reason_for_numpy(Settings().resolved()) == library.reason_against()


def test_without_the_library_the_reason_names_the_platform(monkeypatch: pytest.MonkeyPatch) -> None:

    monkeypatch.setattr(library, "path", lambda: Path("nowhere") / "libkernel.so")
    library._loaded.cache_clear()
    try:
        assert "has not been built" in str(library.reason_against())
        assert library.supported_sets() == ()
        with pytest.raises(RuntimeError, match="has not been built"):
            library.function("fit_problems")
    finally:
        library._loaded.cache_clear()


def test_a_broken_library_is_a_reason(monkeypatch: pytest.MonkeyPatch, tmp_path: object) -> None:

    broken = Path(str(tmp_path)) / "libkernel.so"
    broken.write_bytes(b"this is not a library")
    monkeypatch.setattr(library, "path", lambda: broken)
    library._loaded.cache_clear()
    try:
        assert "cannot be loaded" in str(library.reason_against())
    finally:
        library._loaded.cache_clear()


STALE = """
const char *source_stamp(void) { return "0123456789abcdef"; }
int instruction_set(void) { return 0; }
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("source", [STALE, "int instruction_set(void) { return 0; }"], ids=["other", "without a stamp"])
def test_a_library_of_other_sources_leaves_the_work_to_numpy(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, source: str
) -> None:
    """Such as one that was built before the sources were pulled: its functions may be missing, or take other things."""
    (tmp_path / "stale.c").write_text(source)
    stale = tmp_path / "libstale.so"
    subprocess.run(["cc", "-shared", "-fPIC", str(tmp_path / "stale.c"), "-o", str(stale)], check=True)
    monkeypatch.setattr(library, "path", lambda: stale)
    library._loaded.cache_clear()
    try:
        assert "was built from other sources" in str(library.reason_against())
        assert library.supported_sets() == ()
        result = approximate(*sphere(4), Settings(ring=3, degree=4, iterations=2, workers=1))
        assert result.report["numpy_reason"] == library.reason_against()
    finally:
        library._loaded.cache_clear()


def test_the_stamp_counts_every_source_and_no_line_end(tmp_path: Path) -> None:
    assert source_stamp(tmp_path) is None
    (tmp_path / "a.c").write_bytes(b"int a;\nint b;\n")
    first = source_stamp(tmp_path)
    (tmp_path / "a.c").write_bytes(b"int a;\r\nint b;\r\n")
    assert source_stamp(tmp_path) == first
    (tmp_path / "a.h").write_bytes(b"")
    assert source_stamp(tmp_path) != first

"""What callers of the library bring: refused in one sentence, or taken for what it is; and what they get back."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from sparse_surface.solver import Settings, approximate, denoise
from sparse_surface.solver.errors import InputError, SettingsError
from threadpoolctl import threadpool_info

QUICK = {"iterations": 2, "sweeps": 0, "workers": 1}


def sheet(size: int = 8) -> tuple[np.ndarray, np.ndarray]:
    x, y = (part.ravel() for part in np.meshgrid(*2 * [np.linspace(0.0, 1.0, size)], indexing="ij"))
    i = np.arange(size * size).reshape(size, size)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], axis=2).reshape(-1, 4)
    return np.stack([x, y, 0.2 * np.sin(4.0 * x)], axis=1), quads


def masked() -> np.ma.MaskedArray[Any, Any]:
    return np.ma.masked_array(sheet()[0], mask=np.arange(192).reshape(64, 3) == 5)


@pytest.mark.parametrize(
    ("vertices", "settings", "weights", "error", "said"),
    [
        ([[0.0, 1.0], [2.0]], None, None, InputError, "three numbers each"),
        ([["a", "b", "c"]], None, None, InputError, "three numbers each"),
        (masked(), None, None, InputError, "masked"),
        (None, {}, None, SettingsError, r"Settings\(\.\.\.\)"),
        (None, {"ring": 3}, None, SettingsError, r"Settings\(\.\.\.\)"),
        (None, None, ["a"] * 64, InputError, "one number from 0 to 1"),
        (None, None, [[1.0], [1.0, 2.0]], InputError, "one number from 0 to 1"),
        (None, None, np.ma.masked_equal(np.arange(64) / 64.0, 0.5), InputError, "masked"),
    ],
)
@pytest.mark.parametrize("merging", [True, False])
def test_refusals(vertices: Any, settings: Any, weights: Any, error: type, said: str, merging: bool) -> None:
    points, faces = sheet()
    settings = Settings(**QUICK, merge_vertices=merging) if settings is None else settings
    with pytest.raises(error, match=said) as caught:
        approximate(points if vertices is None else vertices, faces, settings, weights=weights)
    assert "\n" not in str(caught.value)
    if vertices is not None:
        with pytest.raises(InputError, match=said):
            denoise(vertices, faces)


def test_numbers_of_numpy_are_numbers() -> None:
    settings = Settings(ring=np.int64(3), beta1=np.float32(0.25), adaptive=np.bool_(False), sweeps=np.array(0))
    assert settings == Settings(ring=3, beta1=0.25, adaptive=False, sweeps=0)
    assert {type(value) for value in settings.as_dict().values()} <= {int, float, bool, str}
    with pytest.raises(SettingsError, match="whole number"):
        Settings(ring=np.float64(3.5))


def test_an_unmasked_masked_array_is_an_array() -> None:
    points, faces = sheet()
    plain = approximate(points, faces, Settings(**QUICK))
    other = approximate(np.ma.masked_array(points), faces, Settings(**QUICK))
    assert np.array_equal(plain.vertices, other.vertices)
    assert type(other.vertices) is np.ndarray


def test_blas_has_its_threads_again_after_use_from_several_threads() -> None:
    def counts() -> list[int]:
        return [library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"]

    before = counts()
    if max(before, default=1) < 2:
        pytest.skip("BLAS has one thread here")

    def work() -> None:
        approximate(*sheet(), Settings(**QUICK, solver="numpy"))

    for _ in range(2):
        threads = [threading.Thread(target=work) for _ in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert counts() == before

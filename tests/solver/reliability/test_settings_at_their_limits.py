"""Every setting at its limits, beyond them, and in combinations that ask for the impossible."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import pytest
import soundness
from hypothesis import given, settings
from hypothesis import strategies as st
from sparse_surface.benchmarks import generated_models as models
from sparse_surface.solver import Settings, SettingsError
from sparse_surface.solver.patch_methods import METHODS

NUMBERS = [item for item in dataclasses.fields(Settings) if "low" in item.metadata]
CHOICES = [item for item in dataclasses.fields(Settings) if "choices" in item.metadata]
SMALL: dict[str, Any] = {"workers": 1, "iterations": 2, "sweeps": 1, "degree": 6}


def approximated(**changes: Any) -> Any:
    vertices, faces = models.cube(3)
    kind, result = soundness.approximated(vertices, faces, Settings(**{**SMALL, **changes}))
    assert kind == soundness.RESULT, result
    return result


@pytest.mark.parametrize("end", ["low", "high"])
@pytest.mark.parametrize("item", NUMBERS, ids=lambda item: item.name)
def test_a_setting_at_its_end_gives_a_result(item: Any, end: str) -> None:
    if (item.name, end) in {("iterations", "high"), ("sweeps", "high"), ("workers", "high")}:
        Settings(**{item.name: item.metadata[end]})  # valid; only more of the same work
        return
    approximated(**{item.name: type(item.default)(item.metadata[end])})


@pytest.mark.parametrize("item", NUMBERS, ids=lambda item: item.name)
def test_a_setting_beyond_its_end_is_refused_with_its_range(item: Any) -> None:
    low, high = item.metadata["low"], item.metadata["high"]
    whole = isinstance(item.default, int)
    beyond = [low - 1, high + 1] if whole else [low - 1e-3 * max(abs(low), 1), high * 1.001, math.nan, math.inf]
    for value in [*beyond, "many", None, True]:
        with pytest.raises(SettingsError) as refused:
            Settings(**{item.name: value})
        text = str(refused.value)
        soundness.check_sentence(text.replace("None", ""))
        assert text.startswith(item.name)
        assert f"from {low:g} to {high:g}" in text


@pytest.mark.parametrize("item", CHOICES, ids=lambda item: item.name)
def test_an_unknown_choice_is_refused_with_those_there_are(item: Any) -> None:
    for value in ("", "no such thing", 3):
        with pytest.raises(SettingsError) as refused:
            Settings(**{item.name: value})
        assert all(choice in str(refused.value) for choice in item.metadata["choices"])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    "changes",
    [
        {"degree": 0, "sparsity": 496},
        {"degree": 0, "sparsity": 1, "ring": 1},
        {"degree": 30, "sparsity": 60, "ring": 50, "iterations": 1, "sweeps": 0},
        {"degree": 14, "sparsity": 496, "iterations": 1, "sweeps": 0},
        {"beta1": 0.0, "beta2": 0.0},
        {"beta1": 1e6, "beta2": 1e6},
        {"degree": 12, "ring": 1, "basis": "monomial", "pursuit": "omp", "observations": "vertices"},
    ],
    ids=lambda changes: " ".join(f"{name} {value}" for name, value in changes.items()),
)
def test_combinations(method: str, changes: dict[str, Any]) -> None:
    result = approximated(method=method, **changes)
    degree = changes.get("degree", SMALL["degree"])
    support = result.representation.support
    assert support.max() < (degree + 1) * (degree + 2) // 2
    for functions in support.reshape(-1, support.shape[-1]):
        used = functions[functions >= 0]
        assert len(set(used)) == len(used) <= changes.get("sparsity", 15)


def test_no_tolerance_means_off_and_the_smallest_one_is_kept() -> None:
    assert "tolerance" not in approximated(tolerance=0.0).report
    assert approximated(tolerance=1e-12).report["tolerance"]["achieved"] <= 1e-12


@given(st.data())
@settings(max_examples=6)
def test_any_settings_give_a_result(data: st.DataObject) -> None:
    changes = {
        item.name: data.draw(st.sampled_from(sorted(item.metadata["choices"])), item.name) for item in CHOICES
    } | {
        item.name: data.draw(st.booleans(), item.name)
        for item in dataclasses.fields(Settings)
        if isinstance(item.default, bool)
    }
    if changes["creases"] == "marked":  # with others they are refused
        changes |= {"method": "default", "blending": "partition"}
    approximated(
        **changes,
        ring=data.draw(st.integers(1, 50)),
        degree=data.draw(st.integers(0, 8)),
        sparsity=data.draw(st.integers(1, 20)),
        tolerance=data.draw(st.sampled_from([0.0, 1e-3, 0.1])),
        denoise_strength=data.draw(st.floats(0.0, 10.0)),
        noise_level=data.draw(st.sampled_from([0.0, 1e-12, 1e-3, 1e12])),
    )

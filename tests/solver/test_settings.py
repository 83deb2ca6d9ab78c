"""Settings by themselves: automatic choices, presets, what is refused, the examples of the docstrings."""

from __future__ import annotations

import doctest
import subprocess
import sys

import pytest
from sparse_surface.solver import PRESETS, CloudSettings, Settings, SettingsError, settings


def test_the_examples_of_the_docstrings_hold() -> None:
    failed, tried = doctest.testmod(settings)
    assert tried > 0
    assert failed == 0


def test_only_automatic_choices_are_replaced() -> None:
    resolved = Settings(method="paper", basis="legendre", ring=3).resolved()
    assert (resolved.basis, resolved.ring) == ("legendre", 3)
    assert (resolved.blending, resolved.pursuit, resolved.observations) == ("uniform", "omp", "vertices")
    assert resolved.resolved() == resolved


@pytest.mark.parametrize("name", PRESETS)
def test_presets_survive_the_way_through_plain_values(name: str) -> None:
    wanted = Settings(**PRESETS[name])
    assert Settings.from_dict(wanted.as_dict()) == wanted
    assert CloudSettings(**CloudSettings().as_dict()) == CloudSettings()


def test_an_unknown_name_is_refused() -> None:
    with pytest.raises(SettingsError, match="'rings'"):
        Settings.from_dict({"rings": 3})


def test_the_pursuit_of_scikit_learn_is_refused_where_that_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Settings(pursuit="sklearn")
    assert asked.resolved().pursuit == "sklearn"
    monkeypatch.setattr(settings, "find_spec", lambda name: None)
    with pytest.raises(SettingsError, match="needs scikit-learn"):
        asked.resolved()
    assert Settings().resolved().pursuit == "ols"


def test_importing_the_settings_loads_nothing_heavy() -> None:
    script = "import sys, sparse_surface.solver.settings; print([m for m in ('numpy', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, cwd="/")
    assert done.stdout == "[]\n", done.stderr

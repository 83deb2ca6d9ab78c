"""docs/paper.md: written from what was measured, and honest about what was not."""

from __future__ import annotations

import copy
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sparse_surface.solver import Settings

CHECKOUT = Path(__file__).resolve().parent.parent
if str(CHECKOUT / "scripts") not in sys.path:
    sys.path.insert(0, str(CHECKOUT / "scripts"))

from paper_figures import FIGURES  # noqa: E402
from paper_figures.measurements import MEASURED, Notebook  # noqa: E402
from paper_figures.report import PAGE, page  # noqa: E402
from paper_figures.scalar import bent_crease, fit, grid_patch  # noqa: E402


@pytest.fixture
def measured() -> dict[str, dict[str, Any]]:
    content: dict[str, dict[str, Any]] = json.loads(MEASURED.read_text(encoding="utf-8"))
    return content


def targets(text: str) -> list[list[str]]:
    """Return the rows of the page's table of targets."""
    part = text.partition("## In short")[2].partition("\n\n- ")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in part.strip().splitlines()[2:]]


def test_the_page_is_what_the_measurements_give(measured: dict[str, dict[str, Any]]) -> None:
    assert PAGE.read_text(encoding="utf-8") == page(measured), "run `make figures`"


def test_every_picture_that_the_page_shows_is_there_and_small() -> None:
    shown = re.findall(r"\((figures/figure_\d+\.png)\)", PAGE.read_text(encoding="utf-8"))
    assert len(shown) == len(FIGURES)
    paths = [PAGE.parent / name for name in shown]
    assert all(path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n" for path in paths)
    assert sum(path.stat().st_size for path in paths) < 6e6


def test_sections_without_measurements_say_so(measured: dict[str, dict[str, Any]]) -> None:
    assert "Not measured" not in page(measured)
    without = {name: entries for name, entries in measured.items() if name != "figure 9"}
    text = page(without)
    assert text.count("Not measured yet") == 1
    assert "Not measured yet" in text.partition("## Figure 9")[2].partition("## Figure 10")[0]
    assert page({}).count("Not measured yet") >= 10


def test_models_that_were_left_out_are_named_and_not_told_of(measured: dict[str, dict[str, Any]]) -> None:
    fewer = copy.deepcopy(measured)
    fewer["models"] = {key: entry for key, entry in fewer["models"].items() if not key.startswith(("fandisk", "bunny"))}
    fewer["left out"] = {"figure 11": ["Fandisk"], "figure 12": ["Bunny"]}
    text = page(fewer)
    assert "**Left out**" in text
    assert "Fandisk, Bunny" in text
    assert "| Fandisk |" not in text
    assert "| Cube |" in text.partition("## Table 1")[2]
    assert "Not measured" not in text


def test_a_target_that_is_missed_is_called_missed(measured: dict[str, dict[str, Any]]) -> None:
    worse = copy.deepcopy(measured)
    worse["models"]["cube default"]["surface_rms"] = worse["models"]["cube printed"]["surface_rms"] / 3.2
    worse["models"]["flower printed"]["patches"] = 200
    met = {row[0]: row[2] for row in targets(page(worse))}
    assert [asked for asked, answer in met.items() if answer == "**no**"] == [
        "patches within 15 % of Table 1",
        "Cube: default 3.3 times better than paper, as printed, same cover",
    ]


def test_numbers_are_those_of_the_run(measured: dict[str, dict[str, Any]]) -> None:
    runs = measured["models"]
    ratio = runs["cube printed"]["surface_rms"] / runs["cube default"]["surface_rms"]
    assert f"{ratio:.2f}" in next(row[1] for row in targets(page(measured)) if row[0].startswith("Cube: default"))
    changed = copy.deepcopy(measured)
    changed["figure 8"]["rms"] = 0.00789
    assert "7.9e-03" in page(changed)
    assert "7.9e-03" not in page(measured)


def test_a_notebook_keeps_sections_apart(tmp_path: Path) -> None:
    path = tmp_path / "measured.json"
    notebook = Notebook(path)
    notebook.write("one", {"a x": 1, "b y": 2})
    notebook.write("two", {"a": 3})
    notebook.write("one", {"a x": 4})
    notebook.clear("one", "b ")
    assert not path.exists()  # an interrupted figure leaves the numbers that belong to its old picture
    notebook.save()
    assert Notebook(path).content == {"one": {"a x": 4}, "two": {"a": 3}}
    notebook.clear("two")
    notebook.clear("three")
    assert Notebook(path).content["two"] == {"a": 3}
    notebook.save()
    assert Notebook(path).content == {"one": {"a x": 4}}
    assert [found.name for found in tmp_path.iterdir()] == ["measured.json"]


# -------------------------------------------------------------------------------------------------------- scalar data


def test_scalar_data_lie_over_a_triangulation_of_the_square() -> None:
    patch = grid_patch(bent_crease)
    a, b, c = (patch.domain[patch.triangles[:, k]] for k in range(3))
    area = 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(4.0)
    np.testing.assert_array_equal(patch.values, bent_crease(*patch.domain.T))


def test_a_traditional_fit_is_the_least_squares_fit_of_the_functions_it_chose() -> None:
    patch = grid_patch(bent_crease, side=13)
    fitted = fit(patch, Settings(method="traditional", degree=8, sparsity=6))
    degrees = fitted.dictionary.degrees[fitted.support]
    assert len(degrees) == 6
    columns = np.stack([patch.domain[:, 0] ** i * patch.domain[:, 1] ** j for i, j in degrees], axis=1)
    assert [0, 0] in degrees.tolist()  # so that it does not matter from where values are counted
    expected = columns @ np.linalg.lstsq(columns, patch.values, rcond=None)[0]
    np.testing.assert_allclose(fitted.values, expected, atol=1e-9)


def test_the_polynomial_of_a_fit_has_its_values_and_the_default_fits_the_crease_far_better() -> None:
    patch = grid_patch(bent_crease, side=13)
    fits = [fit(patch, Settings(method=method)) for method in ("traditional", "default")]
    for fitted in fits:
        np.testing.assert_allclose(fitted.polynomial(fitted.domain), fitted.values)
        assert fitted.final_rms == pytest.approx(np.sqrt(((fitted.values - patch.values) ** 2).mean()))
        assert fitted.flips == 0
    np.testing.assert_allclose(fits[0].domain, patch.domain, atol=1e-12)
    assert fits[1].final_rms < 0.2 * fits[0].final_rms

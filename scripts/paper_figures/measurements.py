"""What the figures and the page tell: runs of the methods on the models, remembered in docs/figures/measured.json."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from models import CHECKOUT, PaperModel
from sparse_surface.solver import Approximation, Settings, approximate

FIGURES = CHECKOUT / "docs" / "figures"
MEASURED = FIGURES / "measured.json"

TRADITIONAL = Settings(method="traditional", sweeps=0)
PRINTED = Settings(method="paper", sweeps=2)
CONVERGING = Settings(method="paper", sweeps=0, initial_fit="data", rho=1.0)
FREER = Settings(
    method="paper", sweeps=0, initial_fit="data", rho=1.0, regularisation="vertex", observations="centroids"
)
DEFAULT = Settings()

METHODS = {
    "traditional": TRADITIONAL,
    "printed": PRINTED,
    "converging": CONVERGING,
    "freer": FREER,
    "default": DEFAULT,
}
"""Name of a run on the page -> its settings."""


def seconds_of_a_unit() -> float:
    """Return the time of one product of 1000 x 1000 matrices on one core, in which times are told."""
    matrix = np.random.default_rng(0).random((1000, 1000))
    times = []
    for _ in range(5):
        start = time.perf_counter()
        _ = matrix @ matrix
        times.append(time.perf_counter() - start)
    return float(np.median(times))


@dataclass
class Notebook:
    """Figures that were measured, by section and key; written to the file after each entry."""

    path: Path = MEASURED

    def read(self) -> dict[str, dict[str, Any]]:
        if not self.path.exists():
            return {}
        content: dict[str, dict[str, Any]] = json.loads(self.path.read_text(encoding="utf-8"))
        return content

    def write(self, section: str, entries: dict[str, Any]) -> None:
        """Put entries into a section, over earlier ones of the same keys."""
        content = self.read()
        content[section] = {**content.get(section, {}), **entries}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_name(f".{self.path.name}.partial")
        partial.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        partial.replace(self.path)


def measured(model: PaperModel, name: str, notebook: Notebook) -> Approximation:
    """Run a method on a model and note what came of it."""
    unit = seconds_of_a_unit()
    result = approximate(*model.load(), METHODS[name])
    notebook.write("models", {f"{model.key} {name}": essentials(result.report, unit)})
    return result


def essentials(report: dict[str, Any], unit: float) -> dict[str, Any]:
    """Return what the page needs of a report; numbers with as many digits as mean something."""
    seconds = report["seconds"]
    return {
        "vertices": report["input"]["vertices"],
        "patches": report["patches"],
        "flips": report["flipped_triangles"],
        **{key: rounded(value) for key, value in report["relative"].items()},
        "seam": rounded(report["seam_max"] / report["input"]["bounding_box_longest_side"]),
        "normal_degrees": rounded(report["normal_error_degrees"]),
        "seconds": rounded(seconds["total"]),
        "units": rounded(seconds["total"] / unit * report["workers"]),
        "energy": [rounded(value) for value in report["energy"]],
        "patch_rms": [rounded(value) for value in report["iterations"]["patch_rms"]],
    }


def rounded(value: float) -> float:
    return float(f"{value:.3g}")

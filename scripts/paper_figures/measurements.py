"""What the figures and the page tell: runs of the methods on the models, noted in docs/figures/measured.json.

The file is what docs/paper.md is written from.  It lets a single figure be made again while the page keeps the rest; no
figure reads it.
"""

from __future__ import annotations

import json
import os
import time
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from sparse_surface.solver import Approximation, Settings, approximate

from .models import CHECKOUT, Mesh, PaperModel

FIGURES = CHECKOUT / "docs" / "figures"
MEASURED = FIGURES / "measured.json"

TRADITIONAL = Settings(method="traditional", sweeps=2)
PRINTED = Settings(method="paper", sweeps=2)
SETTLING = Settings(method="paper", sweeps=0, initial_fit="data", rho=1.0)
STEPWISE = replace(SETTLING, beta1=0.0, rigidity_reference="previous")
FREER = replace(SETTLING, regularisation="vertex", observations="centroids")
DEFAULT = Settings(creases="off")
"""The fit of the paper's patches by the default method: what can be compared with the paper."""
CREASED = Settings()
"""The default itself, which cuts the mesh along creases before that."""

METHODS = {
    "traditional": TRADITIONAL,
    "printed": PRINTED,
    "settling": SETTLING,
    "freer": FREER,
    "default": DEFAULT,
    "creased": CREASED,
}
"""Name of a run in the notebook -> its settings."""


@cache
def unit() -> float:
    """Return the seconds of processor time of one product of 1000 x 1000 matrices, in which times are told.

    The shortest of several: whatever else the machine does only makes it longer.
    """
    matrix = np.random.default_rng(0).random((1000, 1000))
    times = []
    for _ in range(15):
        start = time.process_time()
        _ = matrix @ matrix
        times.append(time.process_time() - start)
    return min(times)


def timed_approximate(vertices: Any, faces: Any, settings: Settings) -> tuple[Approximation, float]:
    """Approximate; return also the seconds of processor time, this process and its workers together.

    Processor time, since the figures may well be made on a machine that does something else besides.
    """
    start = sum(os.times()[:4])
    result = approximate(vertices, faces, settings)
    return result, sum(os.times()[:4]) - start


class Notebook:
    """Figures that were measured, by section and key.

    They get into the file with `save`, at the end of a figure: where one is interrupted, its old picture and its old
    numbers stay together.
    """

    def __init__(self, path: Path = MEASURED) -> None:
        self.path = path
        self.content: dict[str, dict[str, Any]] = {}
        if path.exists():
            self.content = json.loads(path.read_text(encoding="utf-8"))

    def write(self, section: str, entries: dict[str, Any]) -> None:
        """Put entries into a section, over earlier ones of the same keys."""
        self.content.setdefault(section, {}).update(entries)

    def clear(self, section: str, prefix: str = "") -> None:
        """Take the entries out of a section whose keys begin so."""
        for key in [key for key in self.content.get(section, {}) if key.startswith(prefix)]:
            del self.content[section][key]

    def save(self) -> None:
        """Write the file, beside its place and then into it."""
        content = {section: entries for section, entries in self.content.items() if entries}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        partial = self.path.with_name(f".{self.path.name}.partial")
        partial.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        partial.replace(self.path)


def measured(model: PaperModel, mesh: Mesh, method: str, notebook: Notebook) -> Approximation:
    """Run a method on a model and record its measurements."""
    result, seconds = timed_approximate(*mesh, METHODS[method])
    notebook.write("models", {f"{model.key} {method}": essentials(result.report, seconds)})
    return result


def essentials(report: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Return what the page needs of a report; numbers with as many digits as mean something."""
    return {
        "vertices": report["input"]["vertices"],
        "patches": report["patches"],
        "flips": report["flipped_triangles"],
        **{key: rounded(value) for key, value in report["relative"].items()},
        "normal_degrees": rounded(report["normal_error_degrees"]),
        "seconds": rounded(seconds),
        "units": rounded(seconds / unit()),
        "energy": [rounded(value) for value in report["energy"]],
    }


def rounded(value: float) -> float:
    return float(f"{value:.5g}")

"""The paper's models (Table 1): five generated ones, Fandisk and Bunny where they are in ../shared/models."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from sparse_surface.benchmarks import generated_models as models

CHECKOUT = Path(__file__).resolve().parent.parent.parent
SHARED = CHECKOUT.parent / "shared" / "models"

Mesh = tuple[NDArray[np.float64], NDArray[np.int64]]


@dataclass(frozen=True)
class PaperModel:
    """A row of Table 1.

    Attributes
    ----------
    name
        As in the paper.
    source
        Generator in `solver.models`, or file in ../shared/models.
    creased
        Whether it stands among the models with creases (Fig. 11).
    vertices, patches, minutes
        Printed in Table 1.
    methods
        Names of the runs in `measurements.METHODS`: fewer on the largest model, which takes an hour otherwise.
    """

    name: str
    source: str
    creased: bool
    vertices: int
    patches: int
    minutes: float
    methods: tuple[str, ...] = ("traditional", "printed", "settling", "freer", "default", "creased")

    @property
    def key(self) -> str:
        return self.name.lower()

    @property
    def path(self) -> Path:
        return SHARED / self.source

    @property
    def available(self) -> bool:
        return self.source in models.MODELS or self.path.exists()

    def load(self) -> Mesh:
        """Return vertices scaled to a longest side of 1, as the paper's models are, and faces."""
        vertices, faces = models.MODELS[self.source]() if self.source in models.MODELS else read_mesh(self.path)
        used = vertices[np.unique(faces)]
        return (vertices - used.min(axis=0)) / np.ptp(used, axis=0).max(), faces


PAPER_MODELS = (
    PaperModel("Cube", "cube", True, 1538, 26, 1.3),
    PaperModel("Cubetorus", "cubetorus", True, 2686, 40, 2.33),
    PaperModel("Cylinder", "cylinder", True, 2732, 39, 1.63),
    PaperModel("Fandisk", "fandisk.obj", True, 6475, 88, 4.5),
    PaperModel("Flower", "flower", True, 7919, 97, 5.01),
    PaperModel("Bird", "detailed", False, 55955, 882, 27.8, ("traditional", "printed", "default", "creased")),
    PaperModel("Bunny", "stanford-bunny.ply", False, 35947, 551, 19.1),
)


def read_mesh(path: Path) -> Mesh:
    """Read one of the downloaded meshes: an OBJ of triangles, or a binary PLY whose vertices have only coordinates."""
    if path.suffix == ".obj":
        lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
        vertices = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=np.float64)
        corners = [[int(corner.partition("/")[0]) - 1 for corner in line[1:]] for line in lines if line[:1] == ["f"]]
        return vertices, np.array(corners)
    header, _, body = path.read_bytes().partition(b"end_header\n")
    counts = {line.split()[1]: int(line.split()[2]) for line in header.decode().splitlines() if "element" in line}
    vertices = np.frombuffer(body, dtype="<f4", count=3 * counts["vertex"]).reshape(-1, 3).astype(np.float64)
    row = np.dtype([("size", "u1"), ("corners", "<i4", 3)])
    faces = np.frombuffer(body, dtype=row, count=counts["face"], offset=12 * counts["vertex"])
    return vertices, faces["corners"].astype(np.int64)

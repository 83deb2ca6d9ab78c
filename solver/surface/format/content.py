"""What the head of a file says: kinds, sizes, and how much memory they lead to."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from ..container import demand

LARGEST_EXPANSION, SMALL = 1000, 32_000_000
"""Bytes of memory that a file may lead to for each of its own, and in any case."""

MOST = 1 << 40
MOST_FUNCTIONS = 100_000


@dataclass(frozen=True)
class Sizes:
    """Numbers of things: of the mesh, of its patches, C domains, s functions and I iterations."""

    vertices: int
    faces: int
    face_corners: int
    triangles: int
    nodes: int
    patches: int
    patch_vertices: int
    patch_triangles: int
    domains: int
    functions: int
    iterations: int

    @classmethod
    def read(cls, stated: Any, degree: int, file_bytes: int) -> Sizes:
        """Take the sizes that a head states, unless they contradict each other or lead to too much memory."""
        names = [field.name for field in fields(cls)]
        demand(isinstance(stated, dict) and sorted(stated) == sorted(names), "its sizes are not those of this format")
        demand(all(type(size) is int and 0 <= size <= MOST for size in stated.values()), "a size is not a number")
        sizes = cls(**stated)
        demand(sizes.domains in (1, 3), f"it has {sizes.domains} domains for each patch")
        demand(sizes.functions <= MOST_FUNCTIONS, "a patch has too many functions")
        demand(sizes.vertices <= sizes.nodes <= sizes.vertices + 3 * sizes.triangles, "it has too many nodes")
        demand(sizes.patch_vertices <= 3 * sizes.patch_triangles, "its patches have too many vertices")
        demand(sizes.triangles > 0 and sizes.vertices > 0, "it has no triangles")
        allowed = SMALL + LARGEST_EXPANSION * file_bytes
        demand(sizes.memory(degree) <= allowed, "it would fill the memory with repetitions")
        return sizes

    def memory(self, degree: int) -> int:
        """Bytes of a representation of these sizes, with what evaluating it takes."""
        of_mesh = 24 * (self.vertices + self.nodes) + 16 * self.faces + 8 * self.face_corners + 56 * self.triangles
        of_patches = self.patch_vertices * (16 + 32 * self.domains) + self.patch_triangles * (80 + 48 * self.domains)
        each = 24 * (degree + 1) ** 2 + 64 + 48 * self.functions + 8 * self.iterations
        return of_mesh + of_patches + each * self.patches

    def stated(self) -> dict[str, int]:
        """The sizes as a head states them."""
        return asdict(self)

"""Saving and loading: what a representation can do because it is also a file."""

from __future__ import annotations

import io
import os
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from ..arrays import Array
from ..atomic_files import atomic_output
from ..errors import FileFormatError
from . import files
from .format.initial import initial_domains_of
from .format.ordering import in_walking_order


class Saved:
    """The base of `Representation`: its fields as a file and back."""

    def __getattr__(self, name: str) -> Array:
        """Find the initial domains again, which files do not hold, when they are asked for."""
        method = self.__dict__.get("initial")
        if name != "initial_domains" or not method:
            raise AttributeError(name)
        try:
            self.__dict__[name] = found = initial_domains_of(self, method)
        except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
            raise FileFormatError("The representation has patches that are not disks; its file was changed.") from error
        return found

    @cached_property
    def stored(self) -> bytes:
        """The representation as the content of an exact file; the same bytes for the same representation."""
        return files.to_bytes(self, "exact")

    @cached_property
    def compact(self) -> bytes:
        """The representation as the content of a compact file; the same bytes for the same representation."""
        return files.to_bytes(self, "compact")

    @cached_property
    def draft(self) -> bytes:
        """The representation as the content of a large file that is soon written; the same to the last bit."""
        return files.to_bytes(self, "draft")

    def save(self, path: str | os.PathLike[str], quality: str = "exact", *, keep_vertex_order: bool = True) -> None:
        """Write the representation to a file (`.npz`, see docs/format.md), which appears when it is complete.

        Parameters
        ----------
        path
            The file.
        quality
            "exact": everything to the last bit but the domains, with the surface the same to 5e-7 of the longest side
            of the box around the vertices.  "plain": the same, with the domains as plain numbers for other programs;
            half as large again.  "draft": the same to the last bit, two or three times as large, written in a fraction
            of the time.  "compact": a quarter of the exact one; the surface moves by up to 1e-5 of the side, the
            input's vertices by up to 3e-5.
        keep_vertex_order
            Whether vertices and faces keep their numbers.  Where they need not, a file of a mesh whose order is random
            is half as large: they are numbered as a walk over the mesh meets them, and faces may begin elsewhere.

        Raises
        ------
        InputError
            When there is no such quality.
        OSError
            When the file cannot be written.

        Examples
        --------
        >>> from sparse_surface.solver import approximate, load, save
        >>> save(approximate(vertices, faces).representation, folder / "model.npz")
        >>> points = load(folder / "model.npz").at_vertices()
        """
        kept = self if keep_vertex_order else in_walking_order(self)
        content = kept.compact if quality == "compact" else files.to_bytes(kept, quality)
        with atomic_output(Path(path)) as draft:
            draft.write_bytes(content)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Read what `save` wrote.

        Raises
        ------
        FileFormatError
            When the file is cut, damaged, newer than this version, or something else; in one sentence.
        OSError
            When there is no such file, or it cannot be read.
        """
        with open(path, "rb") as file:
            return cls._of(files.from_file(file, f"'{Path(path).name}'"))

    @classmethod
    def from_bytes(cls, data: bytes, name: str = "The stored representation") -> Self:
        """Read what `stored` or `compact` returned; `name` begins the sentence in which damaged bytes are refused."""
        return cls._of(files.from_file(io.BytesIO(data), name))

    @classmethod
    def _of(cls, fields: dict[str, Any]) -> Self:
        """Make a representation of the fields of a file, which may lack the initial domains."""
        made = cls.__new__(cls)
        made.__dict__.update(fields)
        return made

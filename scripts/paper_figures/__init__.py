"""The figures and tables of the paper, made again: pictures in docs/figures, the page docs/paper.md."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

FIGURES = {f"fig{number}": "patch_figures" if number < 9 else "surface_figures" for number in range(1, 13)}
"""Name of a figure -> the module that draws it.  Table 1 comes with figures 11 and 12."""


def make(name: str) -> Path:
    """Draw a figure into docs/figures, return its path, and write docs/paper.md from the notebook."""
    from .measurements import Notebook
    from .report import write_page

    notebook = Notebook()
    draw = getattr(import_module(f".{FIGURES[name]}", __name__), f"figure_{name[3:]}")
    notebook.clear(f"figure {name[3:]}")
    path: Path = draw(notebook)
    notebook.save()
    write_page(notebook)
    return path

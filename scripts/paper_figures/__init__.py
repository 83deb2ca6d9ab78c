"""The figures and tables of the paper, made anew: pictures in docs/figures, the page docs/paper.md."""

from __future__ import annotations

from collections.abc import Callable

from . import patch_figures, surface_figures
from .measurements import Notebook
from .report import write_page

FIGURES: dict[str, Callable[[Notebook], None]] = {
    "fig1": patch_figures.figure_1,
    "fig2": patch_figures.figure_2,
    "fig3": patch_figures.figure_3,
    "fig4": patch_figures.figure_4,
    "fig5": patch_figures.figure_5,
    "fig6": patch_figures.figure_6,
    "fig7": patch_figures.figure_7,
    "fig8": patch_figures.figure_8,
    "fig9": surface_figures.figure_9,
    "fig10": surface_figures.figure_10,
    "fig11": surface_figures.figure_11,
    "fig12": surface_figures.figure_12,
}
"""Name of a figure -> what draws it and notes what was measured.  Table 1 comes with figures 11 and 12."""


def make(name: str) -> None:
    """Draw a figure into docs/figures and write docs/paper.md from all that was measured so far."""
    notebook = Notebook()
    FIGURES[name](notebook)
    write_page(notebook)

"""Make the pictures of docs/ again, all or those that are named.

python scripts/figures.py                all of them: an hour
python scripts/figures.py heat_map       one of docs/pictures
python scripts/figures.py fig9           a figure of the paper in docs/figures, and docs/paper.md
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import paper_figures
import sparse_surface
from cloud_figures import CLOUD_FIGURES
from demo import approximate, make_flower, make_suzanne
from representation_figures import REPRESENTATION_FIGURES
from sparse_surface.operators.heat_map.picture import render_heatmap

PICTURES = Path(__file__).resolve().parent.parent / "docs" / "pictures"


def heat_map(path: Path) -> None:
    """Render a model with creases beside its result: the README's picture."""
    (source,) = make_flower()
    (result,) = approximate([source])
    render_heatmap(result, path, source=source)


def heat_map_smooth(path: Path) -> None:
    """Render an organic shape beside its result."""
    (source,) = make_suzanne()
    (result,) = approximate([source])
    render_heatmap(result, path, source=source)


FIGURES: dict[str, Callable[[Path], None]] = {
    "heat_map": heat_map,
    "heat_map_smooth": heat_map_smooth,
    **CLOUD_FIGURES,
    **REPRESENTATION_FIGURES,
}
"""Name of a picture in docs/pictures -> what makes it."""


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [*FIGURES, *paper_figures.FIGURES]
    parser.add_argument("names", nargs="*", choices=[[], *names], metavar="NAME", help=", ".join(names))
    options = parser.parse_args(arguments)
    PICTURES.mkdir(parents=True, exist_ok=True)
    sparse_surface.register()
    try:
        for name in options.names or names:
            path = PICTURES / f"{name}.png"
            made = FIGURES[name](path) if name in FIGURES else paper_figures.make(name)
            print((made or path).relative_to(PICTURES.parent.parent), flush=True)
    finally:
        sparse_surface.unregister()
    return 0


if __name__ == "__main__":
    sys.exit(main())

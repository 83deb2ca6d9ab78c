"""The command `reconstruct` for clouds that are too large to be loaded: read in parts, thinned, measured as a whole."""

from __future__ import annotations

import argparse
from dataclasses import dataclass

from bpy.types import Object

from ..operators.files.point_files import PARTS, PointParts, count_of, in_parts
from ..operators.files.points import thin_object
from ..solver.errors import SettingsError
from ..solver.progress import Steps, run_to_end
from ..solver.reconstruction.cleaning import CleanCloud
from ..solver.reconstruction.in_parts import against_all
from ..solver.reconstruction.result import Reconstruction
from ..solver.reconstruction.thinning import ThinCloud, thin_steps
from ..solver.settings import MOST_POINTS, Settings
from .console import console
from .progress import progress_display


@dataclass(frozen=True)
class LargeCloud:
    """A file of points with what thinning left of it.

    Attributes
    ----------
    parts, thin
        The file, and what is left.
    points
        That in the scene.
    settings
        How many threads measure the surface.
    """

    parts: PointParts
    thin: ThinCloud
    points: Object
    settings: Settings

    def measured(self, result: Reconstruction, clean: CleanCloud) -> Steps[Reconstruction]:
        """Measure a surface against all points of the file."""
        return (yield from against_all(result, clean, self.parts, self.thin, self.settings))


def read_large(options: argparse.Namespace) -> LargeCloud | None:
    """Read and thin the points of a file that has many, or where that is asked for; None where neither is so.

    Raises
    ------
    SettingsError
        When it is asked for and the file cannot be read in parts.
    SparseSurfaceError
        When the file cannot be read, or holds too few points.
    """
    path, asked = options.input, options.most_points
    if not path.is_file():
        return None
    if options.object or not in_parts(path):
        if asked:
            raise SettingsError(f"--most-points reads whole files of {', '.join(PARTS)}, and no single objects.")
        return None
    expected = count_of(path)
    if not asked and expected <= MOST_POINTS:
        return None
    parts, name = PointParts(path), path.stem
    with progress_display(name) as show:
        thin = run_to_end(thin_steps(parts, asked or MOST_POINTS, shift=True, expected=expected), show)
    told = f"{thin.extent.finite} points became {len(thin.points)}, the means of cells {thin.grid.cell:.3g} wide"
    console.say(f"{name}: {told} (--most-points {asked or MOST_POINTS})", name)
    return LargeCloud(parts, thin, thin_object(name, thin, parts.meaning), options.settings)

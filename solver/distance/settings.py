"""How distances are measured.  Needs no NumPy: the command line is checked with it."""

import math
from dataclasses import dataclass

from ..errors import SettingsError

ALIGNMENTS = ("none", "rigid", "scaled")


@dataclass(frozen=True)
class DistanceSettings:
    """How to measure.

    Attributes
    ----------
    signed
        Whether distances inside the other mesh are negative.
    align
        "none", "rigid" (moves A onto B first) or "scaled" (moves and scales it).
    tolerance
        Distance up to which a place counts as inside the tolerance, in scene units; 0: none.
    samples
        Places on each mesh over which the statistics are taken.
    bins
        Number of bars of the histogram.

    Raises
    ------
    SettingsError
        When a value is out of range.
    """

    signed: bool = False
    align: str = "none"
    tolerance: float = 0.0
    samples: int = 200_000
    bins: int = 64

    def __post_init__(self) -> None:
        if self.align not in ALIGNMENTS:
            raise SettingsError(f"align must be one of {', '.join(ALIGNMENTS)}, not {self.align!r}.")
        if not 0.0 <= self.tolerance < math.inf:
            raise SettingsError(f"tolerance must be 0 or a positive length, not {self.tolerance}.")
        if not 100 <= self.samples <= 100_000_000:
            raise SettingsError(f"samples must lie between 100 and 100000000, not {self.samples}.")
        if not 2 <= self.bins <= 10_000:
            raise SettingsError(f"bins must lie between 2 and 10000, not {self.bins}.")

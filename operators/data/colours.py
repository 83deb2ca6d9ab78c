"""The colours of error values: one ramp, uniform to the eye and safe for colour-blind readers.

The ramp runs from dark violet over teal to bright yellow.  Its lightness rises all the way, so that it
reads the same in grey, and equal steps of value are equal steps in the perceptual colour space Oklab
(B. Ottosson, 2020).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Colours = NDArray[np.float32]

STEPS = 256

# Lightness, chroma and hue in degrees of the colours that the ramp passes through, in Oklab.
_WAY = ((0.28, 0.120, 300.0), (0.45, 0.120, 262.0), (0.61, 0.095, 210.0), (0.77, 0.140, 155.0), (0.94, 0.185, 108.0))

# Blue and vermilion can be told apart with every kind of colour blindness (M. Okabe, K. Ito, 2008); sRGB.
INSIDE = (0.0, 0.447, 0.698)
OUTSIDE = (0.835, 0.369, 0.0)


@dataclass(frozen=True)
class ColourScale:
    """Which value gets which colour.

    Attributes
    ----------
    low, high
        Values at the ends of the ramp; what lies beyond takes the end's colour.
    tolerance
        Where positive, there are two colours only: `INSIDE` up to it and `OUTSIDE` above.
    """

    low: float
    high: float
    tolerance: float = 0.0

    def colours(self, values: NDArray[np.floating]) -> Colours:
        """Return linear RGBA (n, 4) of the values (n,)."""
        rgba = np.ones((len(values), 4), dtype=np.float32)
        if self.tolerance > 0.0:
            two = srgb_to_linear(np.array([INSIDE, OUTSIDE]))
            rgba[:, :3] = two[(values > self.tolerance).astype(np.intp)]
        else:
            share = (np.asarray(values, dtype=np.float64) - self.low) / max(self.high - self.low, 1e-300)
            rgba[:, :3] = ramp()[np.rint(np.clip(share, 0.0, 1.0) * (STEPS - 1)).astype(np.intp)]
        return rgba


@cache
def ramp() -> Colours:
    """Return the ramp as linear RGB, (STEPS, 3), from small values to large."""
    lightness, chroma, hue = np.array(_WAY).T
    way = np.stack([lightness, chroma * np.cos(np.radians(hue)), chroma * np.sin(np.radians(hue))], axis=1)
    rounded = _smooth_way(way)
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rounded, axis=0), axis=1))])
    even = np.linspace(0.0, lengths[-1], STEPS)
    lab = np.stack([np.interp(even, lengths, rounded[:, k]) for k in range(3)], axis=1)
    return np.clip(_oklab_to_linear(lab), 0.0, 1.0).astype(np.float32)


def _smooth_way(way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Points close to each other on the polynomial through the points `way` (5, 3); it has no corners."""
    knots = np.linspace(-1.0, 1.0, len(way))
    fine = np.linspace(-1.0, 1.0, 16 * STEPS)
    return np.stack([np.polyval(np.polyfit(knots, way[:, k], len(way) - 1), fine) for k in range(3)], axis=1)


def _oklab_to_linear(lab: NDArray[np.float64]) -> NDArray[np.float64]:
    to_cones = np.array(
        [[1.0, 0.3963377774, 0.2158037573], [1.0, -0.1055613458, -0.0638541728], [1.0, -0.0894841775, -1.2914855480]]
    )
    to_rgb = np.array(
        [
            [4.0767416621, -3.3077115913, 0.2309699292],
            [-1.2684380046, 2.6097574011, -0.3413193965],
            [-0.0041960863, -0.7034186147, 1.7076147010],
        ]
    )
    return (lab @ to_cones.T) ** 3 @ to_rgb.T


def srgb_to_linear(colours: NDArray[np.floating]) -> NDArray[np.float64]:
    """Undo the transfer curve of sRGB (IEC 61966-2-1)."""
    colours = np.asarray(colours, dtype=np.float64)
    return np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)


def linear_to_srgb(colours: NDArray[np.floating]) -> NDArray[np.float64]:
    """Apply the transfer curve of sRGB (IEC 61966-2-1)."""
    colours = np.asarray(colours, dtype=np.float64)
    return np.where(colours <= 0.0031308, colours * 12.92, 1.055 * np.clip(colours, 0.0, None) ** (1.0 / 2.4) - 0.055)

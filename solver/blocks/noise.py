"""The noise of a large mesh, estimated from some of its blocks: all are then denoised by the same level."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..denoising.found_noise import removable_noise
from ..settings import Settings
from .cut import Cut, Parts
from .folder import JobFolder

NOISE = "noise.json"

SAMPLED = 5
"""Blocks that are looked at, spread evenly over all."""


def with_noise_level(settings: Settings, parts: Parts, cut: Cut, folder: JobFolder) -> Settings:
    """Return the settings with the noise level that every block is to remove, or with nothing to remove.

    It is the median of the levels of some blocks, the lower one of two; where most are clean, nothing is removed.
    """
    if settings.denoise == "off" or settings.noise_level:
        return settings
    if not folder.is_there(NOISE):
        numbers = np.unique(np.linspace(0, len(cut) - 1, min(SAMPLED, len(cut))).round().astype(int))
        levels = [_level(settings, parts, int(number)) for number in numbers]
        folder.write_json(NOISE, {"levels": levels, "level": float(np.quantile(levels, 0.5, method="lower"))})
    level = float(folder.read_json(NOISE)["level"])
    return replace(settings, noise_level=level) if level else replace(settings, denoise_strength=0.0)


def _level(settings: Settings, parts: Parts, number: int) -> float:
    task = parts.task(number, parts.part(number), settings, settings.ring)
    marked = task.sharp_edges if settings.creases == "marked" else None
    return removable_noise(task.positions, task.faces, marked)

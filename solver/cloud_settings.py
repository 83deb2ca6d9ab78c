"""Settings of a reconstruction from points, beside those of the patches."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields
from typing import Any

from .settings import check_value, choice, number, switch


@dataclass(frozen=True)
class CloudSettings:
    """How points become observations over a base mesh; metadata as in `Settings`.

    Raises
    ------
    SettingsError
        When a value lies outside of its range; the message names the range.
    """

    ring: int = number(
        0,
        0,
        20,
        "Patch radius in edges of the base. 1: the faces around a vertex; 2: all faces that touch these. "
        "0: 1 for clean points, larger where the points are noisy",
        soft=(0, 4),
    )
    robust: str = choice(
        "none",
        "How points far from the surface count",
        none="All points count alike",
        huber="Less, the farther they are: for noise with heavy tails",
        tukey="Not at all beyond a few noise levels: for outliers",
    )
    noise: float = number(
        0.0,
        0.0,
        1e12,
        "Standard deviation of the points across the surface, in scene units. 0: estimated from the points",
    )
    creases: bool = switch(
        True, "Estimate where smooth sides of the cloud meet and observe the surface there too: sharper creases"
    )
    fit_base: bool = switch(
        True,
        "Draw the base to the points, and on to creases that pass near its vertices, before points are projected on it",
    )
    corrections: int = number(
        2,
        0,
        20,
        "How often points are projected anew, on the surface itself, and the patches fitted again. "
        "Each costs a third of the solve",
        soft=(0, 5),
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            check_value(item.name, getattr(self, item.name), item.metadata, type(item.default))

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, in the order of the fields."""
        return asdict(self)

"""An inspection report that a customer can read: one HTML file with pictures, figures, histogram and settings."""

from __future__ import annotations

import base64
import html
import tempfile
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from bpy.types import Object

from ...solver.atomic_files import atomic_output
from ...solver.distance.distance import Distances
from ..data.colours import linear_to_srgb
from ..heat_map.picture import render_heatmap
from ..heat_map.scene import View
from .histogram import bar_colours
from .showing import scale_of

VIEWS = {
    "From the front right": View.three_quarter(-35.0, 24.0),
    "From the back left": View.three_quarter(145.0, 24.0),
    "From above": View.three_quarter(-35.0, 75.0),
}
MEASURES = {
    "rms": "Root mean square",
    "mean": "Mean",
    "p95": "95 % are below",
    "max": "Largest found",
    "max_bound": "None is larger than",
    "signed_mean": "Mean with sign",
}

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 1em 0 } td, th { padding: .25em 1em .25em 0; text-align: left }
tr { border-bottom: 1px solid #ddd } img, svg { width: 100%; height: auto } figure { margin: 1.5em 0 }
figcaption { color: #666 } .warning { background: #fdebd0; padding: .5em 1em }
"""


def write_page(path: Path, shown: Object, other: Object, measured: Distances, title: str, up: str) -> None:
    """Render the standard views and write the page, which needs no other file; it appears when it is complete."""
    report = measured.report
    figures = [_figure(picture, name) for name, picture in _pictures(shown, other, title, up)]
    problem = (report["alignment_quality"] or {}).get("problem")
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        f'<p class="warning">{html.escape(problem)}</p>' if problem else "",
        _measures(report),
        "".join(figures),
        f"<figure>{_bars(measured)}<figcaption>Distances over the area</figcaption></figure>",
        "<h2>Settings</h2>",
        _table([(name, str(value)) for name, value in _settings(report)]),
    ]
    head = f'<meta charset="utf-8"><title>{html.escape(title)}</title><style>{_STYLE}</style>'
    text = f'<!doctype html>\n<html lang="en"><head>{head}</head><body>\n' + "\n".join(parts) + "\n</body></html>\n"
    with atomic_output(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _pictures(shown: Object, other: Object, title: str, up: str) -> list[tuple[str, bytes]]:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "view.png"
        found = []
        for name, view in VIEWS.items():
            render_heatmap(shown, file, source=other, up=up, caption=title, view=view)
            found.append((name, file.read_bytes()))
    return found


def _figure(picture: bytes, caption: str) -> str:
    data = base64.b64encode(picture).decode("ascii")
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}"><figcaption>{caption}</figcaption></figure>'
    )


def _measures(report: dict[str, Any]) -> str:
    names = ("a", "b")
    head = "<tr><th>Distances in scene units</th><th>First to second</th><th>Second to first</th></tr>"
    rows = []
    for key, text in MEASURES.items():
        values = [report[way].get(key) for way in ("a_to_b", "b_to_a")]
        if values[0] is not None:
            cells = "".join(f"<td>{'' if value is None else format(value, '.5g')}</td>" for value in values)
            rows.append(f"<tr><td>{text}</td>{cells}</tr>")
    counts = [f"{report['input'][name]['vertices']:,} vertices" for name in names]
    rows.append(f"<tr><td>Size</td><td>{counts[0]}</td><td>{counts[1]}</td></tr>")
    if report["inside_tolerance"] is not None:
        within = f"Within {report['settings']['tolerance']:.5g}"
        rows.append(f"<tr><td>{within}</td><td>{report['inside_tolerance']:.2%}</td><td></td></tr>")
    return f"<table>{head}{''.join(rows)}</table>"


def _settings(report: dict[str, Any]) -> list[tuple[str, Any]]:
    quality = report["alignment_quality"]
    aligned = [
        (f"alignment, {name.replace('_', ' ')}", value) for name, value in (quality or {}).items() if value != ""
    ]
    versions = [("Sparse Surface", report["version"]), ("Blender", bpy.app.version_string)]
    return [*report["settings"].items(), *aligned, *versions]


def _table(rows: list[tuple[str, str]]) -> str:
    cells = [f"<tr><td>{html.escape(name)}</td><td>{html.escape(value)}</td></tr>" for name, value in rows]
    return f"<table>{''.join(cells)}</table>"


def _bars(measured: Distances) -> str:
    histogram = measured.report["histogram"]
    counts = np.array(histogram["counts"], dtype=np.float64)
    heights = 200.0 * counts / max(counts.max(), 1.0)
    colours = np.rint(255.0 * linear_to_srgb(bar_colours(histogram, scale_of(measured))[:, :3])).astype(int)
    width = 800.0 / len(counts)
    bars = [
        f'<rect x="{k * width:.2f}" y="{210.0 - high:.2f}" width="{0.9 * width:.2f}" height="{high:.2f}" '
        f'fill="rgb({red},{green},{blue})"/>'
        for k, (high, (red, green, blue)) in enumerate(zip(heights, colours.tolist(), strict=True))
    ]
    low, high = histogram["edges"][0], histogram["edges"][-1]
    words = [
        f'<text x="{800 * at:.0f}" y="230" text-anchor="{anchor}" font-size="14">{low + at * (high - low):.4g}</text>'
        for at, anchor in ((0.0, "start"), (0.5, "middle"), (1.0, "end"))
    ]
    return f'<svg viewBox="0 0 800 240" role="img">{"".join(bars)}{"".join(words)}</svg>'

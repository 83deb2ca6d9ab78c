"""Reports in words, for every reader: one line, or rows of figures.  Needs neither NumPy nor Blender."""

from __future__ import annotations

from typing import Any

Report = dict[str, Any]


def one_line(name: str, report: Report) -> str:
    """Return one line about the result of a mesh or a point cloud: size, quality, time."""
    given = report["input"]
    size = f"{given['points']} points over {given['vertices']} vertices" if "points" in given else None
    size = size or f"{given['vertices']} vertices"
    early = ", ended early" if report.get("ended_early") else ""
    return f"{name}: {size}, {quality(report)}, {report['seconds']['total']:.1f} s{early}"


def quality(report: Report) -> str:
    """Say how well the surface is approximated, in scene units and relative to its longest side."""
    if "denoise" not in report:
        return f"{report['patches']} patches, {_surface_error(report, report)}"
    noise = noise_removed(report["denoise"])
    if not report["patches"]:
        return noise
    # What the functions do to the denoised mesh: the noise is not an error of the fit.
    return f"{noise}; fitted with {report['patches']} patches, {_surface_error(report, report['denoise']['fit'])}"


def _surface_error(report: Report, measured: Report) -> str:
    error, size = measured["surface_error"], report["input"]["bounding_box_longest_side"]
    rms, largest = error["rms"], error["max"]
    return f"surface error rms {rms:.3g} ({_share(rms, size)} of the size), max {largest:.3g} ({_share(largest, size)})"


def _share(length: float, size: float) -> str:
    return f"{length / size if size else 0.0:.2e}"


def noise_removed(noise: Report) -> str:
    """Say how much noise was removed, from that part of a report."""
    if not noise["noise_level"]:
        return "no noise found"
    moved = noise["displacement"]
    return (
        f"noise of {noise['noise_level']:.3g} ({noise['relative_noise']:.0%} of the mean edge) removed, "
        f"vertices moved by rms {moved['rms']:.3g}, max {moved['max']:.3g}"
    )


def rows(report: Report) -> list[tuple[str, Any]]:
    """Return the figures of a report with their names, lengths in scene units."""
    errors = [
        (f"{kind} error, {measure}", report[f"{kind.lower()}_error"][measure])
        for kind in ("Vertex", "Surface")
        for measure in ("rms", "mean", "p95", "max")
    ]
    return [
        ("Method", report["method"]),
        ("Vertices", report["input"]["vertices"]),
        ("Patches", report["patches"]),
        *_noise_rows(report),
        *errors,
        ("Normal error, degrees", report["normal_error_degrees"]),
        ("Flipped triangles", report["flipped_triangles"]),
        ("Largest seam", report["seam_max"]),
        ("Seconds", report["seconds"]["total"]),
        *([("Ended early", "yes")] if report.get("ended_early") else []),
    ]


def _noise_rows(report: Report) -> list[tuple[str, Any]]:
    if "denoise" not in report:
        return []
    noise = report["denoise"]
    listed = [("Noise removed", noise["noise_level"]), ("Displacement, rms", noise["displacement"]["rms"])]
    if report["patches"]:
        listed.append(("Fit to the denoised, rms", noise["fit"]["surface_error"]["rms"]))
    return listed


def table(name: str, report: Report) -> str:
    """Return the rows of a report as lines of text under a name."""
    cells = [(label, f"{value:.6g}" if isinstance(value, float) else str(value)) for label, value in rows(report)]
    width = max(len(label) for label, _ in cells)
    return "\n".join([name, *(f"{label:<{width}}  {value}" for label, value in cells)])

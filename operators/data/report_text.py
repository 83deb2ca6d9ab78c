"""Reports in words, for every reader: one line, or rows of figures.  Needs neither NumPy nor Blender."""

from __future__ import annotations

from typing import Any

Report = dict[str, Any]

FAR_FROM_POINTS = 5.0
"""A surface farther than this from the points, in their spacings, is worth a warning."""


def one_line(name: str, report: Report) -> str:
    """Return one line about the result of a mesh or a point cloud: size, quality, time."""
    given = report["input"]
    size = f"{given['points']} points over {given['vertices']} vertices" if "points" in given else None
    size = size or f"{given['vertices']} vertices"
    early = ", ended early" if report.get("ended_early") else ""
    said = "; ".join([quality(report), *warnings(report)])
    return f"{name}: {size}, {said}; {report['seconds']['total']:.1f} s{early}"


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
    rms, largest, at_vertices = error["rms"], error["max"], measured["vertex_error"]["max"]
    return (
        f"surface error rms {rms:.3g} ({_share(rms, size)} of the size), max {largest:.3g} ({_share(largest, size)}), "
        f"at vertices max {at_vertices:.3g}"
    )


def warnings(report: Report) -> list[str]:
    """Say what the errors do not show: what was copied, what turned over, where nothing is known."""
    said = [_copied(report), _turned(report), _doubled(report), _far_from_points(report)]
    return [sentence for sentence in said if sentence]


def _copied(report: Report) -> str:
    copied, vertices = report["passed_through_vertices"], report["input"]["vertices"]
    if copied == vertices and "denoise" not in report:
        within = f" within {report['tolerance']['requested']:.3g}" if "tolerance" in report else ""
        return f"nothing could be approximated{within}: all {vertices} vertices are the input's"
    reproduced = report["vertices_reproduced"]
    return f"{reproduced} of {vertices} vertices copied from the input" if reproduced else ""


def _turned(report: Report) -> str:
    turned = report["faces_turned"]
    return f"{turned} of {report['input']['faces']} faces turned over" if turned else ""


def _doubled(report: Report) -> str:
    doubled = report["input"].get("coincident_vertices", 0)
    return f"{doubled} vertices coincide with others and leave seams open: merge them first" if doubled else ""


def _far_from_points(report: Report) -> str:
    away = report.get("surface_to_points")
    if away is None or away["max_spacings"] <= FAR_FROM_POINTS:
        return ""
    return f"the surface is up to {away['max']:.3g} ({away['max_spacings']:.0f} spacings) from the nearest point"


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
        *_guaranteed_rows(report),
        *_distance_rows(report),
        ("Normal error, degrees", report["normal_error_degrees"]),
        ("Vertices copied", report["vertices_reproduced"]),
        ("Faces turned over", report["faces_turned"]),
        ("Flipped triangles", report["flipped_triangles"]),
        ("Largest seam", report["seam_max"]),
        ("Seconds", report["seconds"]["total"]),
        *([("Ended early", "yes")] if report.get("ended_early") else []),
    ]


def _guaranteed_rows(report: Report) -> list[tuple[str, Any]]:
    bound = report["surface_error"].get("bound")
    return [] if bound is None else [("Surface error, guaranteed", bound)]


def _distance_rows(report: Report) -> list[tuple[str, Any]]:
    if "points_to_surface" not in report:
        return []
    ways = (("Points to surface", "points_to_surface"), ("Surface to points", "surface_to_points"))
    return [(f"{words}, {measure}", report[key][measure]) for words, key in ways for measure in ("rms", "max")]


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
